//! The job file as people write it: every option declared once, unknown keys refused.
//!
//! Each file has the options of one object. What stands in their rows is the schema, the reference
//! page and the help of the command line.

mod auto;
mod camera;
mod denoise;
mod film;
mod light;
mod output;
pub(crate) mod rules;
mod sampling;

pub use auto::{Auto, LeftToThePlan};
pub use camera::{CameraKind, CameraSpec};
pub use denoise::{DenoiseSpec, DenoiseWhen};
pub use film::{FilmSpec, FilterKind, FilterSpec};
pub use light::*;
pub use output::OutputSpec;
pub(crate) use sampling::MAX_SPP;
pub use sampling::SamplingSpec;

use pileus_scene::option::{above, unit};
use pileus_scene::volume_spec::VolumeSpec;
use pileus_scene::{ByName, GlassRule, options};

options! {
    /// A job: what to render, from where, in which light, how well, and where to put it.
    ///
    /// Paths are relative to the job file. Lengths are scene units, angles degrees, colours linear
    /// Rec. 709, coordinates right-handed with +Y up. Comments and unknown keys are refused.
    #[derive(Default)]
    #[schemars(title = "Pileus job", extend("allOf" = rules::job()))]
    pub struct Job {
        /// The schema that editors should check this file against; ignored.
        #[serde(rename = "$schema")]
        schema: String;
        /// A glTF scene (`.gltf` or `.glb`): its cameras, punctual lights and volumes are rendered.
        #[schemars(extend("examples" = ["shot.gltf"]))]
        scene: String;
        /// How the glTF scene is read.
        gltf: GltfSpec;
        /// Volumes, added to those of the scene. They may overlap.
        volumes: Vec<VolumeSpec>;
        /// The camera. Default: the first camera of the scene, else one that frames the volumes.
        camera: CameraSpec;
        /// Lights, added to those of the scene. Without any light in job and scene: the default
        /// sky, a sun and a blue gradient.
        lights: Vec<LightSpec>, rules::one_image;
        /// Size and filter of the image.
        film: FilmSpec;
        /// How the image is sampled.
        sampling: SamplingSpec;
        /// How the picture to look at is freed of noise.
        denoise: DenoiseSpec;
        /// Which files are written.
        output: OutputSpec;
    }
}

options! {
    /// How a glTF scene is read.
    #[derive(Default)]
    pub struct GltfSpec {
        /// Candela and lux of punctual lights are divided by this to give radiant units; 1 takes
        /// the numbers as they are.
        lumens_per_watt: f64 = 683.0, above(0), unit("lm/W");
        /// What a transmissive surface without `KHR_materials_volume` is.
        glass: ByName<GlassRule> = ByName(GlassRule::ClosedMeshesAreSolid);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pileus_scene::json;

    /// The example of the format's specification, without what this version refuses.
    const FULL: &str = r#"{
      "scene": "shot.gltf", "gltf": { "lumens_per_watt": 683.0 },
      "volumes": [
        { "name": "cloud", "vdb": "cumulus.vdb", "density": { "grid": "density", "scale": 40.0 },
          "extinction": [1.0, 1.0, 1.0], "albedo": [0.999, 0.999, 0.999],
          "phase": { "type": "henyey_greenstein", "g": 0.8 }, "interpolation": "trilinear",
          "transform": { "translation": [0,0,0], "rotation": [0,0,0,1], "scale": [1,1,1] } },
        { "name": "fog", "homogeneous": { "sigma_t": 0.01, "bounds": null }, "albedo": 0.9 }
      ],
      "camera": { "position": [0,1,5], "look_at": [0,1,0], "up": [0,1,0], "fov_y": 35.0, "shutter": [0.0, 0.0] },
      "lights": [
        { "type": "sun", "to_light": [0.5,0.8,-0.3], "irradiance": [3,3,3], "angular_diameter": 0.0 },
        { "type": "environment", "radiance": [0.3,0.4,0.6] },
        { "type": "environment", "image": "sky.exr", "intensity": 1.0, "rotation_y": 0.0 },
        { "type": "point", "position": [0,3,0], "intensity": [10,10,10] }
      ],
      "film": { "resolution": [480,270], "crop": null, "filter": { "type": "box", "radius": 0.5 } },
      "sampling": { "spp": 64, "seed": 0, "max_bounces": null, "transmittance": "auto", "distance": "auto" },
      "denoise": { "when": "end" },
      "output": { "image": "cloud.exr", "preview": "cloud.png", "stats": "cloud.stats.json", "aovs": [] }
    }"#;

    #[test]
    fn reads_the_whole_format_and_writes_it_back() {
        let job: Job = json::parse(FULL).unwrap();
        let again: Job = json::parse(&serde_json::to_string_pretty(&job).unwrap()).unwrap();
        assert_eq!(job, again);
        assert_eq!(json::parse::<Job>("{}").unwrap(), Job::default());
    }

    #[test]
    fn faults_name_the_nearest_key_and_the_place() {
        for (right, wrong, pointer, near) in [
            ("\"scale\": 40.0", "\"sclae\": 40.0", "/volumes/0/density/sclae", "`scale`"),
            ("\"sampling\"", "\"samplng\"", "/samplng", "`sampling`"),
            ("\"irradiance\"", "\"iradiance\"", "/lights/0/iradiance", "`irradiance`"),
            ("\"fov_y\"", "\"fov\"", "/camera/fov", "`fov_y`"),
            ("\"type\": \"box\"", "\"type\": \"boxx\"", "/film/filter/type", "`box`"),
            (
                "\"transmittance\": \"auto\"",
                "\"transmittance\": \"rato\"",
                "/sampling/transmittance",
                "`ratio`",
            ),
            ("\"bounds\"", "\"bound\"", "/volumes/1/homogeneous/bound", "`bounds`"),
        ] {
            let text = FULL.replacen(right, wrong, 1);
            assert_ne!(text, FULL);
            let fault = json::parse::<Job>(&text).unwrap_err();
            assert_eq!(fault.pointer, pointer);
            assert!(fault.remedy.contains(&format!("did you mean {near}")), "{fault:?}");
        }
        let fault = json::parse::<Job>("{\"sampling\": {\"spp\": -3}}").unwrap_err();
        assert_eq!(fault.pointer, "/sampling/spp");
        let fault = json::parse::<Job>("{\"film\": {\"resolution\": [4]}}").unwrap_err();
        assert_eq!(fault.pointer, "/film/resolution");
    }
}
