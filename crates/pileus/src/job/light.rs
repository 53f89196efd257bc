//! Lights of a job.

use pileus_scene::option::{at_least, below, between, unit};
use pileus_scene::options;
use pileus_scene::volume_spec::{LARGEST_COLOR, Rgb};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::rules;

/// A light.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum LightSpec {
    /// Light from infinitely far away.
    Sun(SunSpec),
    /// Light from all around: either `radiance` or `image`.
    Environment(EnvironmentSpec),
    /// Sun and sky of a clear day, in W/(m2 sr) weighted by the eye (times 683: cd/m2). The sun
    /// stands at `to_sun`, or at `elevation` and `azimuth`, no lower than 6 degrees below the
    /// horizon. Excludes environments with an `image`.
    Sky(SkySpec),
    /// Light from a point, the same in all directions.
    Point(PointSpec),
}

options! {
    /// Light from infinitely far away.
    pub struct SunSpec {
        /// Direction from the scene to the sun, of any length.
        required to_light: [f64; 3], rules::directed;
        /// Irradiance on a plane facing the sun.
        required irradiance: Rgb;
        /// Full opening angle of the disc; 0 is a single direction.
        angular_diameter: f64 = 0.0, at_least(0), below(180), unit("degrees");
    }
}

options! {
    /// Light from all around.
    #[derive(Default)]
    #[schemars(extend("allOf" = rules::environment()))]
    pub struct EnvironmentSpec {
        /// Radiance, the same from all directions.
        radiance: Rgb;
        /// A latitude-longitude image (`.exr` or `.hdr`), +Y up, its middle column at -Z.
        image: String;
        /// Factor on the image.
        intensity: f64 = 1.0, between(0, LARGEST_COLOR);
        /// Turns the image counter-clockwise seen from above.
        rotation_y: f64 = 0.0, unit("degrees");
    }
}

options! {
    /// Sun and sky of a clear day.
    #[derive(Default)]
    #[schemars(extend("allOf" = rules::sky()))]
    pub struct SkySpec {
        /// Direction from the scene to the sun, of any length.
        to_sun: [f64; 3], rules::directed;
        /// The sun's height above the horizon.
        elevation: f64, between(-6, 90), unit("degrees");
        /// Where the sun stands, clockwise seen from above: 0 is at -Z, 90 at +X. Goes with
        /// `elevation`, default 0.
        azimuth: f64, unit("degrees");
        /// Haze: 2 is very clear, 3 clear, 6 hazy.
        turbidity: f64 = 3.0, between(1, 10);
        /// Share of light that the ground reflects: what is below the horizon, and a glow in the
        /// sky.
        ground_albedo: Rgb = Rgb::Grey(0.2), rules::at_most_one;
        /// Factor on sun, sky and ground; 1 is physical.
        intensity: f64 = 1.0, between(0, 1e12);
        /// Whether the sun's disc is there. The sky stays the same without it.
        sun: bool = true;
        /// Full opening angle of the sun's disc; 0 is a single direction. Its irradiance stays the
        /// same.
        sun_angular_diameter: f64 = 0.53, at_least(0), below(180), unit("degrees");
    }
}

options! {
    /// Light from a point, the same in all directions.
    pub struct PointSpec {
        /// Where it is.
        required position: [f64; 3], unit("scene units");
        /// Radiant intensity per steradian: irradiance at distance 1, facing the light.
        required intensity: Rgb;
    }
}
