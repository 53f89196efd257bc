//! Suns, points and spots: each has a file here and a row in the table of [`Light`]. What plan,
//! light sampling and reports ask of a light is answered in its file, as [`Punctual`].

mod point;
mod spot;
mod sun;

pub use point::Point;
pub use spot::Spot;
pub use sun::Sun;

use glam::{DVec3, Vec3};

/// What is asked of a light of any kind.
pub trait Punctual {
    /// What one and several of it are called: "point light", "point lights".
    const NAMES: [&'static str; 2];

    /// How bright it is, linear Rec. 709: irradiance on a plane that faces it where it has no
    /// [position](Punctual::position), else radiant intensity where that is greatest, per
    /// steradian.
    fn strength(&self) -> Vec3;

    /// Where it is, in scene units; `None` if it is infinitely far away.
    fn position(&self) -> Option<DVec3>;

    /// Whether it has a size, so that paths can run into it.
    fn has_extent(&self) -> bool {
        false
    }

    /// A unit axis, and the cosine of the angle to it up to which a light with a position sends
    /// light: -1 for light into all directions. The choice among many lights relies on it.
    fn cone(&self) -> (Vec3, f32) {
        (Vec3::Z, -1.0)
    }

    /// Radiant intensity of a light with a position into a unit direction away from it, linear Rec.
    /// 709.
    fn intensity_toward(&self, direction: Vec3) -> Vec3;

    /// Its type and parameters as `pileus info` writes them, angles in degrees.
    fn description(&self) -> serde_json::Value;
}

/// Makes [`Light`] of a table with one row for each kind: what it is, and the type that implements
/// [`Punctual`].
macro_rules! lights {
    ($($(#[doc = $about:literal])+ $Kind:ident;)+) => {
        /// A light of the scene, in world space.
        #[derive(Debug, Clone, PartialEq)]
        #[non_exhaustive]
        pub enum Light {
            $($(#[doc = $about])+ $Kind($Kind),)+
        }

        impl Light {
            /// What one and several of its kind are called: see [`Punctual::NAMES`].
            pub fn names(&self) -> [&'static str; 2] {
                match self { $(Light::$Kind(_) => $Kind::NAMES,)+ }
            }

            /// How bright it is: see [`Punctual::strength`].
            pub fn strength(&self) -> Vec3 {
                match self { $(Light::$Kind(light) => light.strength(),)+ }
            }

            /// Where it is; `None` if it is infinitely far away.
            pub fn position(&self) -> Option<DVec3> {
                match self { $(Light::$Kind(light) => light.position(),)+ }
            }

            /// Whether it has a size, so that paths can run into it.
            pub fn has_extent(&self) -> bool {
                match self { $(Light::$Kind(light) => light.has_extent(),)+ }
            }

            /// Where it sends light to: see [`Punctual::cone`].
            pub fn cone(&self) -> (Vec3, f32) {
                match self { $(Light::$Kind(light) => light.cone(),)+ }
            }

            /// Radiant intensity into a unit direction: see [`Punctual::intensity_toward`].
            #[inline]
            pub fn intensity_toward(&self, direction: Vec3) -> Vec3 {
                match self { $(Light::$Kind(light) => light.intensity_toward(direction),)+ }
            }

            /// Its type and parameters as `pileus info` writes them.
            pub fn description(&self) -> serde_json::Value {
                match self { $(Light::$Kind(light) => light.description(),)+ }
            }
        }
    };
}

lights! {
    /// Light from infinitely far away.
    Sun;
    /// Light from a point, the same in all directions.
    Point;
    /// Light from a point into a cone.
    Spot;
}
