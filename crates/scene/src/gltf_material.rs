//! Materials of a glTF file: metallic-roughness and the extensions that are modelled.

use glam::{Vec3, Vec4};
use pileus_media::elementary::ln;
use serde::Deserialize;

use crate::error::Error;
use crate::gltf_texture::{Meaning, TextureInfo, Textures};
use crate::json::Document;
use crate::surface::{Alpha, Interior, Material, Texture, single_scattering_albedo};

/// Extensions of materials that are modelled.
pub(crate) const MODELLED: [&str; 10] = [
    "KHR_materials_clearcoat",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_volume",
    "KHR_materials_volume_scatter",
];

#[derive(Debug, Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct MaterialJson {
    name: String,
    pbr_metallic_roughness: Pbr,
    normal_texture: Option<TextureInfo>,
    emissive_factor: [f32; 3],
    emissive_texture: Option<TextureInfo>,
    alpha_mode: String,
    alpha_cutoff: f32,
    double_sided: bool,
    extensions: Extensions,
}

impl Default for MaterialJson {
    fn default() -> Self {
        Self {
            name: String::new(),
            pbr_metallic_roughness: Pbr::default(),
            normal_texture: None,
            emissive_factor: [0.0; 3],
            emissive_texture: None,
            alpha_mode: "OPAQUE".into(),
            alpha_cutoff: 0.5,
            double_sided: false,
            extensions: Extensions::default(),
        }
    }
}

#[derive(Debug, Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct Pbr {
    base_color_factor: [f32; 4],
    base_color_texture: Option<TextureInfo>,
    metallic_factor: f32,
    roughness_factor: f32,
    metallic_roughness_texture: Option<TextureInfo>,
}

impl Default for Pbr {
    fn default() -> Self {
        Self {
            base_color_factor: [1.0; 4],
            base_color_texture: None,
            metallic_factor: 1.0,
            roughness_factor: 1.0,
            metallic_roughness_texture: None,
        }
    }
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Extensions {
    #[serde(rename = "KHR_materials_clearcoat")]
    clearcoat: Option<Clearcoat>,
    #[serde(rename = "KHR_materials_diffuse_transmission")]
    diffuse_transmission: Option<DiffuseTransmission>,
    #[serde(rename = "KHR_materials_emissive_strength")]
    emissive_strength: Option<EmissiveStrength>,
    #[serde(rename = "KHR_materials_ior")]
    ior: Option<Ior>,
    #[serde(rename = "KHR_materials_sheen")]
    sheen: Option<Sheen>,
    #[serde(rename = "KHR_materials_specular")]
    specular: Option<Specular>,
    #[serde(rename = "KHR_materials_transmission")]
    transmission: Option<Transmission>,
    #[serde(rename = "KHR_materials_unlit")]
    unlit: Option<serde::de::IgnoredAny>,
    #[serde(rename = "KHR_materials_volume")]
    volume: Option<Volume>,
    #[serde(rename = "KHR_materials_volume_scatter")]
    volume_scatter: Option<VolumeScatter>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct Clearcoat {
    clearcoat_factor: f32,
    clearcoat_texture: Option<TextureInfo>,
    clearcoat_roughness_factor: f32,
    clearcoat_roughness_texture: Option<TextureInfo>,
}

#[derive(Debug, Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct DiffuseTransmission {
    diffuse_transmission_factor: f32,
    diffuse_transmission_texture: Option<TextureInfo>,
    diffuse_transmission_color_factor: [f32; 3],
    diffuse_transmission_color_texture: Option<TextureInfo>,
}

impl Default for DiffuseTransmission {
    fn default() -> Self {
        Self {
            diffuse_transmission_factor: 0.0,
            diffuse_transmission_texture: None,
            diffuse_transmission_color_factor: [1.0; 3],
            diffuse_transmission_color_texture: None,
        }
    }
}

#[derive(Debug, Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct EmissiveStrength {
    emissive_strength: f32,
}

impl Default for EmissiveStrength {
    fn default() -> Self {
        Self { emissive_strength: 1.0 }
    }
}

#[derive(Debug, Deserialize)]
#[serde(default)]
struct Ior {
    ior: f32,
}

impl Default for Ior {
    fn default() -> Self {
        Self { ior: 1.5 }
    }
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct Sheen {
    sheen_color_factor: [f32; 3],
    sheen_color_texture: Option<TextureInfo>,
    sheen_roughness_factor: f32,
    sheen_roughness_texture: Option<TextureInfo>,
}

#[derive(Debug, Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct Specular {
    specular_factor: f32,
    specular_texture: Option<TextureInfo>,
    specular_color_factor: [f32; 3],
    specular_color_texture: Option<TextureInfo>,
}

impl Default for Specular {
    fn default() -> Self {
        Self {
            specular_factor: 1.0,
            specular_texture: None,
            specular_color_factor: [1.0; 3],
            specular_color_texture: None,
        }
    }
}

#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct Transmission {
    transmission_factor: f32,
    transmission_texture: Option<TextureInfo>,
}

#[derive(Debug, Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct Volume {
    thickness_factor: f32,
    attenuation_distance: Option<f32>,
    attenuation_color: [f32; 3],
}

impl Default for Volume {
    fn default() -> Self {
        Self { thickness_factor: 0.0, attenuation_distance: None, attenuation_color: [1.0; 3] }
    }
}

/// The draft's keys.
#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct VolumeScatter {
    multiscatter_color: [f32; 3],
    scatter_anisotropy: f32,
}

/// Darkest attenuation colour: black would be an infinite extinction.
const DARKEST: f32 = 1e-6;

/// All materials of a file, and glTF's default material as one more at the end.
pub(crate) fn load(
    document: &Document,
    textures: &mut Textures<'_>,
) -> Result<Vec<Material>, Error> {
    let found = document.parse_at::<Vec<MaterialJson>>("/materials").transpose()?;
    let mut materials = Vec::new();
    for (i, json) in found.unwrap_or_default().iter().enumerate() {
        let mut reader = Reader { document, textures, pointer: format!("/materials/{i}") };
        materials.push(reader.material(json)?);
    }
    materials.push(Material::default());
    Ok(materials)
}

struct Reader<'a, 'b> {
    document: &'a Document,
    textures: &'a mut Textures<'b>,
    pointer: String,
}

impl Reader<'_, '_> {
    fn texture(
        &mut self,
        info: &Option<TextureInfo>,
        meaning: Meaning,
        key: &str,
    ) -> Result<Option<Texture>, Error> {
        let Some(info) = info else { return Ok(None) };
        self.textures.load(info, meaning, &format!("{}/{key}", self.pointer)).map(Some)
    }

    fn check(&self, right: bool, key: &str, what: &str) -> Result<(), Error> {
        if right {
            return Ok(());
        }
        let place = self.document.place(&format!("{}/{key}", self.pointer));
        Err(Error::invalid(place, what, "correct the material and export again"))
    }

    /// Values are at least 0 and finite.
    fn check_factor(&self, values: &[f32], key: &str) -> Result<(), Error> {
        let right = values.iter().all(|v| *v >= 0.0 && v.is_finite());
        self.check(right, key, "the factor is negative or not finite")
    }

    fn material(&mut self, json: &MaterialJson) -> Result<Material, Error> {
        let alpha = match json.alpha_mode.as_str() {
            "OPAQUE" => Alpha::Opaque,
            "MASK" => Alpha::Mask(json.alpha_cutoff),
            "BLEND" => Alpha::Blend,
            _ => {
                let what = "the alpha mode is not OPAQUE, MASK or BLEND";
                self.check(false, "alphaMode", what)?;
                Alpha::Opaque
            }
        };
        let mut material = Material {
            name: json.name.clone(),
            alpha,
            double_sided: json.double_sided,
            ..Material::default()
        };
        self.metallic_roughness(&json.pbr_metallic_roughness, &mut material)?;
        if let Some(info) = &json.normal_texture {
            self.check(info.scale.is_finite(), "normalTexture/scale", "the scale is not finite")?;
            let texture = self.texture(&json.normal_texture, Meaning::Data, "normalTexture")?;
            material.normal_texture = texture.map(|texture| (texture, info.scale));
        }
        let extensions = &json.extensions;
        let strength = extensions.emissive_strength.as_ref().map_or(1.0, |e| e.emissive_strength);
        let emission = Vec3::from_array(json.emissive_factor) * strength;
        self.check_factor(&emission.to_array(), "emissiveFactor")?;
        material.emission = emission;
        material.emission_texture =
            self.texture(&json.emissive_texture, Meaning::Color, "emissiveTexture")?;
        self.layers(extensions, &mut material)?;
        self.transmission(extensions, &mut material)?;
        self.interior(extensions, &mut material)?;
        if extensions.unlit.is_some() {
            // The other extensions are not for such materials (KHR_materials_unlit).
            material.unlit = true;
            material.transmission = 0.0;
            material.diffuse_transmission = 0.0;
            material.clearcoat = 0.0;
            material.sheen_color = Vec3::ZERO;
            material.volume = None;
            material.interior = None;
        }
        Ok(material)
    }

    fn metallic_roughness(&mut self, pbr: &Pbr, material: &mut Material) -> Result<(), Error> {
        const KEY: &str = "pbrMetallicRoughness";
        self.check_factor(&pbr.base_color_factor, &format!("{KEY}/baseColorFactor"))?;
        self.check_factor(&[pbr.metallic_factor], &format!("{KEY}/metallicFactor"))?;
        self.check_factor(&[pbr.roughness_factor], &format!("{KEY}/roughnessFactor"))?;
        material.base_color = Vec4::from_array(pbr.base_color_factor);
        material.metallic = pbr.metallic_factor;
        material.roughness = pbr.roughness_factor;
        let key = format!("{KEY}/baseColorTexture");
        material.base_color_texture =
            self.texture(&pbr.base_color_texture, Meaning::Color, &key)?;
        let key = format!("{KEY}/metallicRoughnessTexture");
        material.metallic_roughness_texture =
            self.texture(&pbr.metallic_roughness_texture, Meaning::Data, &key)?;
        Ok(())
    }

    /// Index of refraction, specular, clear coat, sheen.
    fn layers(&mut self, extensions: &Extensions, material: &mut Material) -> Result<(), Error> {
        if let Some(Ior { ior }) = &extensions.ior {
            let key = "extensions/KHR_materials_ior/ior";
            let right = *ior == 0.0 || *ior >= 1.0 && ior.is_finite();
            self.check(right, key, "the index of refraction is neither at least 1 nor 0")?;
            material.ior = if *ior == 0.0 { f32::INFINITY } else { *ior };
        }
        if let Some(specular) = &extensions.specular {
            let key = |name: &str| format!("extensions/KHR_materials_specular/{name}");
            self.check_factor(&[specular.specular_factor], &key("specularFactor"))?;
            self.check_factor(&specular.specular_color_factor, &key("specularColorFactor"))?;
            material.specular = specular.specular_factor;
            material.specular_color = Vec3::from_array(specular.specular_color_factor);
            material.specular_texture =
                self.texture(&specular.specular_texture, Meaning::Data, &key("specularTexture"))?;
            material.specular_color_texture = self.texture(
                &specular.specular_color_texture,
                Meaning::Color,
                &key("specularColorTexture"),
            )?;
        }
        if let Some(coat) = &extensions.clearcoat {
            let key = |name: &str| format!("extensions/KHR_materials_clearcoat/{name}");
            let factors = [coat.clearcoat_factor, coat.clearcoat_roughness_factor];
            self.check_factor(&factors, &key("clearcoatFactor"))?;
            [material.clearcoat, material.clearcoat_roughness] = factors;
            material.clearcoat_texture =
                self.texture(&coat.clearcoat_texture, Meaning::Data, &key("clearcoatTexture"))?;
            material.clearcoat_roughness_texture = self.texture(
                &coat.clearcoat_roughness_texture,
                Meaning::Data,
                &key("clearcoatRoughnessTexture"),
            )?;
        }
        if let Some(sheen) = &extensions.sheen {
            let key = |name: &str| format!("extensions/KHR_materials_sheen/{name}");
            self.check_factor(&sheen.sheen_color_factor, &key("sheenColorFactor"))?;
            self.check_factor(&[sheen.sheen_roughness_factor], &key("sheenRoughnessFactor"))?;
            material.sheen_color = Vec3::from_array(sheen.sheen_color_factor);
            material.sheen_roughness = sheen.sheen_roughness_factor;
            material.sheen_color_texture = self.texture(
                &sheen.sheen_color_texture,
                Meaning::Color,
                &key("sheenColorTexture"),
            )?;
            material.sheen_roughness_texture = self.texture(
                &sheen.sheen_roughness_texture,
                Meaning::Data,
                &key("sheenRoughnessTexture"),
            )?;
        }
        Ok(())
    }

    fn transmission(
        &mut self,
        extensions: &Extensions,
        material: &mut Material,
    ) -> Result<(), Error> {
        if let Some(transmission) = &extensions.transmission {
            let key = |name: &str| format!("extensions/KHR_materials_transmission/{name}");
            self.check_factor(&[transmission.transmission_factor], &key("transmissionFactor"))?;
            material.transmission = transmission.transmission_factor;
            material.transmission_texture = self.texture(
                &transmission.transmission_texture,
                Meaning::Data,
                &key("transmissionTexture"),
            )?;
        }
        if let Some(diffuse) = &extensions.diffuse_transmission {
            let key = |name: &str| format!("extensions/KHR_materials_diffuse_transmission/{name}");
            let factor = diffuse.diffuse_transmission_factor;
            let color = diffuse.diffuse_transmission_color_factor;
            self.check_factor(&[factor], &key("diffuseTransmissionFactor"))?;
            self.check_factor(&color, &key("diffuseTransmissionColorFactor"))?;
            material.diffuse_transmission = factor;
            material.diffuse_transmission_color = Vec3::from_array(color);
            material.diffuse_transmission_texture = self.texture(
                &diffuse.diffuse_transmission_texture,
                Meaning::Data,
                &key("diffuseTransmissionTexture"),
            )?;
            material.diffuse_transmission_color_texture = self.texture(
                &diffuse.diffuse_transmission_color_texture,
                Meaning::Color,
                &key("diffuseTransmissionColorTexture"),
            )?;
        }
        Ok(())
    }

    fn interior(&mut self, extensions: &Extensions, material: &mut Material) -> Result<(), Error> {
        let Some(volume) = &extensions.volume else { return Ok(()) };
        let key = |name: &str| format!("extensions/KHR_materials_volume/{name}");
        self.check_factor(&[volume.thickness_factor], &key("thicknessFactor"))?;
        self.check_factor(&volume.attenuation_color, &key("attenuationColor"))?;
        material.volume = Some(volume.thickness_factor > 0.0);
        let Some(distance) = volume.attenuation_distance else { return Ok(()) };
        let what = "the attenuation distance is not above 0";
        self.check(distance > 0.0, &key("attenuationDistance"), what)?;
        let sigma_t = volume.attenuation_color.map(|c| {
            // The first is -0 for white.
            (-ln(c.clamp(DARKEST, 1.0)) / distance).max(0.0)
        });
        let sigma_t = Vec3::from_array(sigma_t);
        self.check(sigma_t.is_finite(), &key("attenuationDistance"), what)?;
        let mut interior = Interior { sigma_a: sigma_t, sigma_s: Vec3::ZERO, g: 0.0 };
        if let Some(scatter) = &extensions.volume_scatter {
            let key = |name: &str| format!("extensions/KHR_materials_volume_scatter/{name}");
            let g = scatter.scatter_anisotropy;
            let what = "the anisotropy is not between -1 and 1";
            self.check(g.abs() < 1.0, &key("scatterAnisotropy"), what)?;
            self.check_factor(&scatter.multiscatter_color, &key("multiscatterColor"))?;
            let albedo = Vec3::from_array(
                scatter.multiscatter_color.map(|c| single_scattering_albedo(c, g)),
            );
            interior = Interior { sigma_a: sigma_t * (1.0 - albedo), sigma_s: sigma_t * albedo, g };
        }
        material.interior = (sigma_t != Vec3::ZERO).then_some(interior);
        Ok(())
    }
}
