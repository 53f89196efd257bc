//! Sun and sky of a clear day by the model of Hosek and Wilkie.

use libm::{acos, asin, cos, sin};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

use glam::{DVec3, Vec3};
use hw_skymodel::rgb::{Channel, SkyParams, SkyState};

use super::sunlight::sunlight;
use crate::error::{Error, Place};
use crate::light::environment::EnvironmentImage;
use crate::light::punctual::{Light, Sun};

/// Texels around the horizon.
const WIDTH: usize = 512;
/// Texels from zenith to nadir; even, so that the horizon is a border of texels.
const HEIGHT: usize = 256;
/// The sun's lowest elevation, degrees: the end of civil twilight.
const LOWEST_ELEVATION: f64 = -6.0;
/// Logarithm by which light falls per degree below the horizon: from the model's 2.4 klx with the
/// sun on the horizon (turbidity 3) to 3.4 lx at the end of civil twilight, its common figure.
const TWILIGHT_PER_DEGREE: f64 = 1.09;

/// Sun and sky of a clear day.
///
/// The sky: Hosek and Wilkie, "An analytic model for full spectral sky-dome radiance", SIGGRAPH
/// 2012, its RGB fit from the crate `hw-skymodel`. The sun: the solar spectrum through the
/// atmosphere of Preetham, Shirley and Smits 1999. Radiance is linear Rec. 709 in W/(m^2 sr)
/// weighted by the CIE 1931 observer without the factor of 683 lm/W, like that of black bodies: its
/// luminance times 683 lm/W is in cd/m^2. A horizontal plane under a high sun receives some 100
/// klx, about 150 W/m^2.
///
/// Approximations: the models know no sun below the horizon. From there to -6 degrees the sky is
/// that of a sun on the horizon, dimmed to 3.4 lx at the end of civil twilight, in the same
/// colours; the sun's disc sets as it crosses the horizon. The observer is on the ground, at sea
/// level. Light is evaluated once by the machine's own elementary functions: the last bits may
/// differ between machines.
#[derive(Debug, Clone, PartialEq)]
pub struct ClearSky {
    /// Direction from the scene to the sun, of any length but 0; +Y is up. At least -6 degrees
    /// high.
    pub to_sun: DVec3,
    /// Haze, 1 to 10: 2 is very clear, 3 clear, 6 hazy, 10 very hazy.
    pub turbidity: f64,
    /// Share of light that the ground reflects, 0 to 1 per channel.
    pub ground_albedo: [f64; 3],
    /// Factor on all light.
    pub intensity: f64,
    /// Whether there is a sun's disc.
    pub sun: bool,
    /// Full opening angle of the disc in degrees, from 0 to below 180; 0 is a delta direction. Its
    /// irradiance does not depend on it.
    pub sun_angular_diameter: f64,
}

impl Default for ClearSky {
    fn default() -> Self {
        Self {
            to_sun: DVec3::new(0.0, 1.0, -1.0),
            turbidity: 3.0,
            ground_albedo: [0.2; 3],
            intensity: 1.0,
            sun: true,
            sun_angular_diameter: 0.53,
        }
    }
}

/// What is wrong with a [`ClearSky`].
#[derive(Debug, Clone, PartialEq)]
pub struct SkyFault {
    /// Name of the field.
    pub field: &'static str,
    /// What is wrong.
    pub what: String,
    /// What to do about it.
    pub remedy: &'static str,
}

impl ClearSky {
    /// Direction to the sun from its elevation above the horizon and its azimuth, both in degrees:
    /// azimuth 0 is at -Z, 90 at +X (a compass with north at -Z). A unit vector.
    pub fn direction(elevation: f64, azimuth: f64) -> DVec3 {
        let (sin_e, cos_e) = libm::sincos(elevation.to_radians());
        let (sin_a, cos_a) = libm::sincos(azimuth.to_radians());
        DVec3::new(cos_e * sin_a, sin_e, -cos_e * cos_a)
    }

    /// The first field whose value is out of range.
    pub fn fault(&self) -> Option<SkyFault> {
        let fault = |field, what: String, remedy| Some(SkyFault { field, what, remedy });
        if self.to_sun.try_normalize().is_none() {
            let remedy = "give a vector that is finite and not zero";
            return fault("to_sun", "the sun has no direction".into(), remedy);
        }
        let elevation = self.elevation();
        // A direction made from the lowest elevation is accepted in spite of rounding.
        if elevation < LOWEST_ELEVATION - 1e-6 {
            return fault(
                "to_sun",
                format!("the sun is {:.2} degrees below the horizon", -elevation),
                "raise it to at least -6 degrees, the end of civil twilight; light nights by other means",
            );
        }
        if !(1.0..=10.0).contains(&self.turbidity) {
            let what = format!("turbidity {}", self.turbidity);
            return fault("turbidity", what, "use a number from 1 (pure air) to 10 (haze)");
        }
        if !self.ground_albedo.iter().all(|albedo| (0.0..=1.0).contains(albedo)) {
            let what = format!("the ground's albedo is {:?}", self.ground_albedo);
            return fault("ground_albedo", what, "use numbers from 0 to 1");
        }
        if !(0.0..=1e12).contains(&self.intensity) {
            let what = format!("intensity {}", self.intensity);
            return fault("intensity", what, "use a number from 0 to 1e12; 1 is physical");
        }
        if !(0.0..180.0).contains(&self.sun_angular_diameter) {
            return fault(
                "sun_angular_diameter",
                format!("the sun is {} degrees wide", self.sun_angular_diameter),
                "use an angle of at least 0 and below 180; seen from the Earth it is 0.53",
            );
        }
        None
    }

    /// The sun's light, if there is one: not after it has set.
    pub fn sun(&self) -> Result<Option<Light>, Error> {
        self.check()?;
        let irradiance = (self.sunlight() * self.intensity).as_vec3();
        if !self.sun || irradiance == Vec3::ZERO {
            return Ok(None);
        }
        Ok(Some(Light::Sun(Sun {
            to_light: self.to_sun.normalize_or_zero().as_vec3().normalize(),
            irradiance,
            angular_diameter: self.sun_angular_diameter.to_radians() as f32,
        })))
    }

    /// The sky without the sun's disc, and the ground below it lit by both: 512 x 256 texels.
    ///
    /// The ground is lit by the sun even if [`sun`](Self::sun) is off: the sky is the same with and
    /// without its disc.
    pub fn image(&self) -> Result<EnvironmentImage, Error> {
        self.check()?;
        let elevation = self.elevation();
        let state = SkyState::new(&SkyParams {
            elevation: elevation.to_radians().clamp(0.0, FRAC_PI_2) as f32,
            turbidity: self.turbidity as f32,
            albedo: self.ground_albedo.map(|albedo| albedo as f32),
        })
        .map_err(|error| self.invalid(error.to_string(), "use values in range"))?;
        let twilight = libm::exp(TWILIGHT_PER_DEGREE * elevation.min(0.0));
        let to_sun = self.to_sun.normalize_or_zero();
        let above = HEIGHT / 2;
        let mut texels = Vec::with_capacity(WIDTH * HEIGHT);
        let mut irradiance = DVec3::ZERO;
        for y in 0..above {
            let border = |row: usize| PI * row as f64 / HEIGHT as f64;
            let theta = 0.5 * (border(y) + border(y + 1));
            // Integral of the cosine over the solid angle of a texel, exact.
            let weight =
                (sin(border(y + 1)).powi(2) - sin(border(y)).powi(2)) * 0.5 * TAU / WIDTH as f64;
            for x in 0..WIDTH {
                // The middle column lies at -Z, to its right is +X.
                let phi = TAU * ((x as f64 + 0.5) / WIDTH as f64 - 0.5);
                let d = DVec3::new(sin(theta) * sin(phi), cos(theta), -sin(theta) * cos(phi));
                let gamma = acos(d.dot(to_sun).clamp(-1.0, 1.0)) as f32;
                let channel = |c| f64::from(state.radiance(theta as f32, gamma, c)).max(0.0);
                let radiance = twilight
                    * DVec3::new(channel(Channel::R), channel(Channel::G), channel(Channel::B));
                irradiance += weight * radiance;
                texels.push(radiance.as_vec3().to_array());
            }
        }
        irradiance += self.sunlight() * to_sun.y.max(0.0);
        let ground = DVec3::from_array(self.ground_albedo) * irradiance / PI;
        texels.resize(WIDTH * HEIGHT, ground.as_vec3().to_array());
        EnvironmentImage::new(WIDTH, HEIGHT, texels, self.intensity as f32, 0.0)
    }

    /// Irradiance by the sun on a plane that faces it, without `intensity`.
    fn sunlight(&self) -> DVec3 {
        let elevation = self.elevation();
        let visible = visible_share(elevation, 0.5 * self.sun_angular_diameter);
        if visible == 0.0 {
            DVec3::ZERO
        } else {
            visible * sunlight(elevation.max(0.0), self.turbidity)
        }
    }

    /// Height of the sun above the horizon, degrees.
    fn elevation(&self) -> f64 {
        asin(self.to_sun.normalize_or_zero().y.clamp(-1.0, 1.0)).to_degrees()
    }

    fn check(&self) -> Result<(), Error> {
        match self.fault() {
            Some(fault) => {
                Err(self.invalid(format!("{}: {}", fault.field, fault.what), fault.remedy))
            }
            None => Ok(()),
        }
    }

    fn invalid(&self, what: String, remedy: &str) -> Error {
        Error::invalid(Place { part: Some("sky".into()), ..Place::default() }, what, remedy)
    }
}

/// Share of a disc of `radius` above the horizon if its middle is at `elevation`: the area of a
/// segment of a circle.
fn visible_share(elevation: f64, radius: f64) -> f64 {
    if radius <= 0.0 || elevation.abs() >= radius {
        return if elevation >= 0.0 { 1.0 } else { 0.0 };
    }
    let h = elevation / radius;
    ((asin(h) + h * (1.0 - h * h).sqrt()) / PI + 0.5).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::super::sunlight::{LUMENS_PER_WATT, LUMINANCE};
    use super::*;

    fn sky(elevation: f64, turbidity: f64) -> ClearSky {
        ClearSky { to_sun: ClearSky::direction(elevation, 70.0), turbidity, ..ClearSky::default() }
    }

    fn luminance(rgb: DVec3) -> f64 {
        LUMENS_PER_WATT * rgb.dot(LUMINANCE)
    }

    /// Illuminance of the horizontal plane by sky and by sun, lux.
    fn illuminance(sky: &ClearSky) -> (f64, f64) {
        // The ground of albedo 1 would send back all of it: its radiance tells it.
        let image = sky.image().unwrap();
        let ground =
            image.radiance(Vec3::NEG_Y).as_dvec3() * PI / DVec3::from_array(sky.ground_albedo);
        let sun = luminance(sky.sunlight()) * sky.to_sun.normalize().y.max(0.0);
        (luminance(ground) - sun, sun)
    }

    /// Chromaticity of the zenith by Preetham, Shirley and Smits 1999, appendix A.2: another fit,
    /// of other data.
    fn preetham_zenith(elevation: f64, t: f64) -> [f64; 2] {
        let s = (90.0 - elevation).to_radians();
        let chromaticity = |m: [[f64; 4]; 3]| -> f64 {
            let powers = [t * t, t, 1.0];
            let row = |r: [f64; 4]| ((r[0] * s + r[1]) * s + r[2]) * s + r[3];
            m.iter().zip(powers).map(|(r, p)| p * row(*r)).sum()
        };
        [
            chromaticity([
                [0.00166, -0.00375, 0.00209, 0.0],
                [-0.02903, 0.06377, -0.03202, 0.00394],
                [0.11693, -0.21196, 0.06052, 0.25886],
            ]),
            chromaticity([
                [0.00275, -0.00610, 0.00317, 0.0],
                [-0.04214, 0.08970, -0.04153, 0.00516],
                [0.15346, -0.26756, 0.06670, 0.26688],
            ]),
        ]
    }

    fn chromaticity(rgb: DVec3) -> [f64; 2] {
        let xyz = glam::DMat3::from_cols(
            DVec3::new(0.412_456_4, 0.212_672_9, 0.019_333_9),
            DVec3::new(0.357_576_1, 0.715_152_2, 0.119_192_0),
            DVec3::new(0.180_437_5, 0.072_175_0, 0.950_304_1),
        ) * rgb;
        [xyz.x / xyz.element_sum(), xyz.y / xyz.element_sum()]
    }

    /// Luminance of the zenith of a clear sky, Krochmann 1970 (in the CIE clear sky), within its
    /// scatter of a third; its colour as by Preetham's fit.
    #[test]
    fn the_zenith_is_as_published() {
        for elevation in [20.0f64, 30.0, 40.0, 50.0, 60.0] {
            for turbidity in [2.0, 3.0, 5.0] {
                let zenith =
                    sky(elevation, turbidity).image().unwrap().radiance(Vec3::Y).as_dvec3();
                let ([x, y], expected) =
                    (chromaticity(zenith), preetham_zenith(elevation, turbidity));
                assert!(
                    (x - expected[0]).abs() < 0.02 && (y - expected[1]).abs() < 0.02,
                    "{elevation} {turbidity}: {x} {y} {expected:?}"
                );
                if turbidity == 3.0 {
                    let krochmann = 100.0
                        + 63.0 * elevation
                        + elevation * (elevation - 30.0) * (0.0346 * (elevation - 68.0)).exp();
                    let ratio = luminance(zenith) / krochmann;
                    assert!((0.66..1.34).contains(&ratio), "{elevation}: {ratio}");
                }
            }
        }
    }

    /// Illuminance by the clear sky of the IES (Gillette and Treado 1983; IES Lighting Handbook):
    /// the sun gives 127.5 exp(-0.21 / sin h) klx on a plane that faces it, the sky 0.8 + 15.5
    /// sin(h)^0.5 klx on the horizontal plane.
    #[test]
    fn illuminance_is_that_of_clear_days() {
        for elevation in [15.0f64, 20.0, 30.0, 45.0, 60.0, 75.0, 90.0] {
            let sin = elevation.to_radians().sin();
            let (from_sky, from_sun) = illuminance(&sky(elevation, 2.5));
            let ies_sun = 127_500.0 * (-0.21 / sin).exp() * sin;
            let ies_sky = 800.0 + 15_500.0 * sin.sqrt();
            let ratio = from_sky / ies_sky;
            assert!((0.8..1.4).contains(&ratio), "sky at {elevation}: {ratio}");
            let ratio = from_sun / ies_sun;
            assert!((0.7..1.2).contains(&ratio), "sun at {elevation}: {ratio}");
            let ratio = (from_sky + from_sun) / (ies_sky + ies_sun);
            assert!((0.85..1.15).contains(&ratio), "both at {elevation}: {ratio}");
        }
        // The end of civil twilight.
        let (twilight, none) = illuminance(&sky(-6.0, 3.0));
        assert!((3.0..3.8).contains(&twilight) && none == 0.0, "{twilight}");
    }

    #[test]
    fn light_is_finite_positive_and_continuous() {
        for turbidity in [1.0, 1.7, 5.5, 10.0] {
            let mut before: Option<f64> = None;
            for step in 0..=32 {
                let elevation = -6.0 + 3.0 * f64::from(step);
                let sky = sky(elevation, turbidity);
                let image = sky.image().unwrap();
                for d in [Vec3::Y, Vec3::X, Vec3::NEG_Z, Vec3::new(-0.7, 0.1, 0.7), Vec3::NEG_Y] {
                    let radiance = image.radiance(d.normalize());
                    assert!(radiance.is_finite() && radiance.min_element() >= 0.0);
                    assert!(radiance.max_element() > 0.0, "{turbidity} {elevation} {d}");
                }
                let (from_sky, _) = illuminance(&sky);
                if let Some(before) = before {
                    let ratio = from_sky / before;
                    assert!((0.8..28.0).contains(&ratio), "{turbidity} {elevation}: {ratio}");
                }
                before = Some(from_sky);
            }
        }
        // The horizon joins both sides (in the model as a cube root of the elevation); so does the
        // setting disc.
        let near = |e| illuminance(&sky(e, 3.0)).0;
        assert!((near(-1e-9) / near(1e-9) - 1.0).abs() < 0.01);
        assert!((visible_share(0.0, 0.265) - 0.5).abs() < 1e-12);
        assert!(visible_share(-0.2649, 0.265) < 1e-3 && visible_share(0.2649, 0.265) > 0.999);
        assert_eq!((visible_share(-1.0, 0.265), visible_share(1.0, 0.265)), (0.0, 1.0));
    }

    /// The aureole is where the sun is: azimuth is a compass with north at -Z.
    #[test]
    fn the_sky_is_brightest_at_the_sun() {
        for (azimuth, d) in
            [(0.0, Vec3::NEG_Z), (90.0, Vec3::X), (180.0, Vec3::Z), (270.0, Vec3::NEG_X)]
        {
            let day =
                ClearSky { to_sun: ClearSky::direction(20.0, azimuth), ..ClearSky::default() };
            let to_sun = day.to_sun.as_vec3();
            assert!(
                (to_sun - (d * 20f32.to_radians().cos() + Vec3::Y * 20f32.to_radians().sin()))
                    .length()
                    < 1e-6
            );
            let image = day.image().unwrap();
            let at = |d: Vec3| image.radiance(d.normalize()).element_sum();
            for other in [Vec3::Y, Vec3::X, Vec3::Z, Vec3::NEG_X, Vec3::NEG_Z] {
                assert!(at(to_sun) > at(other), "{azimuth} {other}");
            }
        }
    }

    #[test]
    fn the_disc_can_be_left_out_and_sets() {
        let day = sky(30.0, 3.0);
        let Some(Light::Sun(sun)) = day.sun().unwrap() else { panic!() };
        assert!((f64::from(sun.angular_diameter).to_degrees() - 0.53).abs() < 1e-6);
        let half = ClearSky { intensity: 0.5, sun_angular_diameter: 5.0, ..day.clone() };
        let Some(Light::Sun(dim)) = half.sun().unwrap() else { panic!() };
        assert!((dim.irradiance * 2.0 - sun.irradiance).length() < 1e-4);
        let without = ClearSky { sun: false, ..day.clone() };
        assert_eq!(without.sun().unwrap(), None);
        assert_eq!(
            without.image().unwrap().radiance(Vec3::NEG_Y),
            day.image().unwrap().radiance(Vec3::NEG_Y)
        );
        assert!(sky(-0.2, 3.0).sun().unwrap().is_some());
        assert!(sky(-0.3, 3.0).sun().unwrap().is_none());
    }

    #[test]
    fn values_out_of_range_are_faults() {
        let day = ClearSky::default();
        assert_eq!(day.fault(), None);
        for (field, bad) in [
            ("to_sun", ClearSky { to_sun: DVec3::ZERO, ..day.clone() }),
            ("to_sun", ClearSky { to_sun: DVec3::NAN, ..day.clone() }),
            ("to_sun", ClearSky { to_sun: DVec3::INFINITY, ..day.clone() }),
            ("to_sun", sky(-6.01, 3.0)),
            ("turbidity", sky(10.0, 0.99)),
            ("turbidity", sky(10.0, 10.01)),
            ("turbidity", sky(10.0, f64::NAN)),
            ("ground_albedo", ClearSky { ground_albedo: [0.0, 1.01, 0.0], ..day.clone() }),
            ("intensity", ClearSky { intensity: f64::INFINITY, ..day.clone() }),
            ("sun_angular_diameter", ClearSky { sun_angular_diameter: -1.0, ..day.clone() }),
        ] {
            assert_eq!(bad.fault().unwrap().field, field);
            assert!(bad.sun().is_err() && bad.image().is_err());
        }
        for edge in [sky(-6.0, 3.0), sky(90.0, 1.0), sky(90.0, 10.0), sky(0.0, 10.0)] {
            assert!(edge.image().is_ok());
        }
    }
}
