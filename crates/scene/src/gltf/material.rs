//! Materials of a glTF file: metallic-roughness and the extensions that are modelled.

use std::collections::{BTreeMap, BTreeSet};

use glam::{Vec3, Vec4};
use pileus_math::elementary::ln;
use serde::Deserialize;
use serde_json::Value;

use super::texture::{Meaning, TextureInfo, Textures};
use crate::error::Error;
use crate::json::Document;
use crate::surface::{Alpha, Interior, Material, Scatter, Texture};

/// Extensions of materials that are modelled.
pub(crate) const MODELLED: [&str; 11] = [
    "KHR_materials_clearcoat",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_scatter",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_volume",
    "KHR_materials_volume_scatter",
];

/// The keys of what is modelled, in the version that is read; those without an effect here are the
/// ones that the specification keeps for renderers without rays, or that are listed by themselves.
const KEYS: [(&str, &[&str]); 12] = [
    (
        "KHR_materials_clearcoat",
        &[
            "clearcoatFactor",
            "clearcoatTexture",
            "clearcoatRoughnessFactor",
            "clearcoatRoughnessTexture",
            "clearcoatNormalTexture",
        ],
    ),
    (
        "KHR_materials_diffuse_transmission",
        &[
            "diffuseTransmissionFactor",
            "diffuseTransmissionTexture",
            "diffuseTransmissionColorFactor",
            "diffuseTransmissionColorTexture",
        ],
    ),
    ("KHR_materials_emissive_strength", &["emissiveStrength"]),
    ("KHR_materials_ior", &["ior"]),
    (
        "KHR_materials_scatter",
        &[
            "scatterStrengthFactor",
            "scatterStrengthTexture",
            "scatterFactor",
            "scatterTexture",
            "multiscatterColorFactor",
            "multiscatterColorTexture",
            "scatterAnisotropy",
        ],
    ),
    (
        "KHR_materials_sheen",
        &["sheenColorFactor", "sheenColorTexture", "sheenRoughnessFactor", "sheenRoughnessTexture"],
    ),
    (
        "KHR_materials_specular",
        &["specularFactor", "specularTexture", "specularColorFactor", "specularColorTexture"],
    ),
    ("KHR_materials_transmission", &["transmissionFactor", "transmissionTexture"]),
    ("KHR_materials_unlit", &[]),
    (
        "KHR_materials_volume",
        &["thicknessFactor", "thicknessTexture", "attenuationDistance", "attenuationColor"],
    ),
    (
        "KHR_materials_volume_scatter",
        &[
            "multiscatterColorFactor",
            "multiscatterColorTexture",
            "multiscatterColor",
            "scatterAnisotropy",
        ],
    ),
    ("KHR_texture_transform", &["offset", "rotation", "scale", "texCoord"]),
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
    #[serde(rename = "KHR_materials_scatter")]
    scatter: Option<ScatterJson>,
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

/// The drafts' keys: `multiscatterColor` of 2025, and those of spring 2026.
#[derive(Debug, Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct VolumeScatter {
    multiscatter_color: Option<[f32; 3]>,
    multiscatter_color_factor: Option<[f32; 3]>,
    multiscatter_color_texture: Option<TextureInfo>,
    scatter_anisotropy: f32,
}

/// The draft that replaces it; its text says `scatterStrengthFactor`, its schema `scatterFactor`.
#[derive(Debug, Deserialize)]
#[serde(default, rename_all = "camelCase")]
struct ScatterJson {
    #[serde(alias = "scatterFactor")]
    scatter_strength_factor: f32,
    #[serde(alias = "scatterTexture")]
    scatter_strength_texture: Option<TextureInfo>,
    multiscatter_color_factor: [f32; 3],
    multiscatter_color_texture: Option<TextureInfo>,
    scatter_anisotropy: f32,
}

impl Default for ScatterJson {
    fn default() -> Self {
        Self {
            scatter_strength_factor: 0.0,
            scatter_strength_texture: None,
            multiscatter_color_factor: [1.0; 3],
            multiscatter_color_texture: None,
            scatter_anisotropy: 0.0,
        }
    }
}

/// Darkest attenuation colour: black would be an infinite extinction.
const MIN_ATTENUATION_COLOR: f32 = 1e-6;

/// The materials of a file, and glTF's default material as one more at the end. Those that are not
/// among `used` are not looked at: default materials stand in their places. What has no effect is
/// said in `not_modelled`.
pub(crate) fn load(
    document: &Document,
    textures: &mut Textures<'_>,
    used: &BTreeSet<usize>,
    not_modelled: &mut Vec<String>,
) -> Result<Vec<Material>, Error> {
    let found = document.parse_at::<Vec<Value>>("/materials").transpose()?.unwrap_or_default();
    let mut unknown = UnknownKeys::default();
    let mut materials = Vec::new();
    for (i, value) in found.iter().enumerate() {
        if !used.contains(&i) {
            materials.push(Material::default());
            continue;
        }
        let pointer = format!("/materials/{i}");
        let json = MaterialJson::deserialize(value).or_else(|error| {
            // Read again where it stands, for the place of the fault.
            let again = document.parse_at::<MaterialJson>(&pointer).transpose()?;
            again.ok_or_else(|| {
                let place = document.place(&pointer);
                Error::invalid(place, error.to_string(), "export the file again")
            })
        })?;
        unknown.find(value, &json.name);
        let mut reader = Reader { document, textures, pointer };
        let material = reader.material(&json)?;
        let scatters = json.extensions.scatter.is_some_and(|s| s.scatter_strength_factor > 0.0);
        if scatters && material.volume != Some(true) && material.transmission > 0.0 {
            not_modelled.push(format!(
                "scattering of thin walls (KHR_materials_scatter without a thickness in \
                 KHR_materials_volume) in material `{}`: it is shown clear",
                material.name
            ));
        }
        materials.push(material);
    }
    not_modelled.extend(unknown.sentences());
    materials.push(Material::default());
    Ok(materials)
}

/// Keys in extensions that are modelled which are not among [`KEYS`]: by extension and key how many
/// materials have them, and the name of the first.
#[derive(Default)]
struct UnknownKeys(BTreeMap<(&'static str, String), (usize, String)>);

/// Most unknown keys that are listed one by one.
const MAX_LISTED: usize = 32;

impl UnknownKeys {
    /// Looks for such keys in a material, the textures in it included.
    fn find(&mut self, material: &Value, name: &str) {
        let mut keys = BTreeSet::new();
        visit(material, &mut keys);
        for key in keys {
            let found = self.0.entry(key).or_insert_with(|| (0, name.to_owned()));
            found.0 += 1;
        }
    }

    fn sentences(&self) -> impl Iterator<Item = String> + '_ {
        let more = self.0.len().saturating_sub(MAX_LISTED);
        let one = |((extension, key), (count, name)): (&(&str, String), &(usize, String))| {
            let others = match count - 1 {
                0 => String::new(),
                1 => " and one more".to_owned(),
                n => format!(" and {n} more"),
            };
            let known = KEYS.iter().find(|(known, _)| known == extension).map_or(&[][..], |k| k.1);
            let known = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
            format!(
                "key `{key}` of {extension} in material `{name}`{others}: it is not known and has \
                 no effect; known are {known}"
            )
        };
        let rest = (more > 0).then(|| format!("{more} more unknown keys of extensions"));
        self.0.iter().take(MAX_LISTED).map(one).chain(rest)
    }
}

/// Collects unknown keys of the extensions anywhere in a value. The depth of JSON is bounded by its
/// parser.
fn visit(value: &Value, found: &mut BTreeSet<(&'static str, String)>) {
    match value {
        Value::Array(values) => values.iter().for_each(|value| visit(value, found)),
        Value::Object(object) => {
            let extensions = object.get("extensions").and_then(Value::as_object);
            for (extension, content) in extensions.into_iter().flatten() {
                let Some((extension, known)) = KEYS.iter().find(|(name, _)| name == extension)
                else {
                    continue;
                };
                for key in content.as_object().into_iter().flat_map(serde_json::Map::keys) {
                    let common = key == "extensions" || key == "extras";
                    if !common && !known.contains(&key.as_str()) {
                        found.insert((extension, key.clone()));
                    }
                }
            }
            let parts = object.iter().filter(|(key, _)| *key != "extras");
            parts.for_each(|(_, value)| visit(value, found));
        }
        _ => {}
    }
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
            material.scatter = None;
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
            (-ln(c.clamp(MIN_ATTENUATION_COLOR, 1.0)) / distance).max(0.0)
        });
        let sigma_t = Vec3::from_array(sigma_t);
        self.check(sigma_t.is_finite(), &key("attenuationDistance"), what)?;
        if sigma_t == Vec3::ZERO {
            return Ok(());
        }
        let scatter = self.scatter(extensions, sigma_t)?;
        material.interior = Some(match &scatter {
            Some(s) => Interior::of_albedo(sigma_t, s.multiscatter, s.g),
            None => Interior { sigma_a: sigma_t, sigma_s: Vec3::ZERO, g: 0.0 },
        });
        let textured =
            |s: &Scatter| s.multiscatter_texture.is_some() || s.strength_texture.is_some();
        material.scatter = scatter.filter(textured).map(Box::new);
        Ok(())
    }

    /// Scattering by either draft; where both stand, the newer one counts.
    fn scatter(
        &mut self,
        extensions: &Extensions,
        sigma_t: Vec3,
    ) -> Result<Option<Scatter>, Error> {
        let (name, color, color_key, texture, strength, g);
        if let Some(scatter) = &extensions.scatter {
            name = "KHR_materials_scatter";
            (color, color_key) = (scatter.multiscatter_color_factor, "multiscatterColorFactor");
            texture = &scatter.multiscatter_color_texture;
            strength = (scatter.scatter_strength_factor, &scatter.scatter_strength_texture);
            g = scatter.scatter_anisotropy;
        } else if let Some(scatter) = &extensions.volume_scatter {
            name = "KHR_materials_volume_scatter";
            texture = &scatter.multiscatter_color_texture;
            (color, color_key) =
                match (scatter.multiscatter_color_factor, scatter.multiscatter_color) {
                    (Some(color), _) => (color, "multiscatterColorFactor"),
                    (None, Some(color)) => (color, "multiscatterColor"),
                    // Black unless something is said, as in the drafts; a texture says something.
                    (None, None) => {
                        let color = if texture.is_some() { [1.0; 3] } else { [0.0; 3] };
                        (color, "multiscatterColorFactor")
                    }
                };
            strength = (1.0, &None);
            g = scatter.scatter_anisotropy;
        } else {
            return Ok(None);
        }
        let key = |key: &str| format!("extensions/{name}/{key}");
        let what = "the anisotropy is not between -1 and 1";
        self.check(g.abs() < 1.0, &key("scatterAnisotropy"), what)?;
        self.check_factor(&color, &key(color_key))?;
        self.check_factor(&[strength.0], &key("scatterStrengthFactor"))?;
        let texture = self.texture(texture, Meaning::Color, &key("multiscatterColorTexture"))?;
        // Its alpha counts, which is the same in an image of colours: often one and the same.
        let strength_texture =
            self.texture(strength.1, Meaning::Color, &key("scatterStrengthTexture"))?;
        Ok(Some(Scatter {
            sigma_t,
            multiscatter: Vec3::from_array(color) * strength.0.min(1.0),
            multiscatter_texture: texture,
            strength_texture,
            g,
        }))
    }
}
