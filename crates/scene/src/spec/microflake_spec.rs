//! What a user writes about media of microflakes.

use super::option::{between, written};
use super::volume_rules as rules;
use crate::options;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How a microflake scatters light.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MicroflakeScatteringSpec {
    /// The microflake is a mirror.
    #[default]
    Specular,
    /// The microflake is a matte surface.
    Diffuse,
}

/// Kinds of distributions of microflakes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MicroflakeShapeSpec {
    /// In all directions alike. Takes no other keys.
    Isotropic,
    /// Around a fibre: normals across an axis. Takes `axis` or `axis_grid`, `roughness` or
    /// `roughness_grid`.
    Fibre,
    /// Of a surface: normals along an axis. Takes the same keys.
    Surface,
    /// Any symmetric matrix S: the area shown to a unit direction w is the root of `w' S w`. Takes
    /// `diagonal` and `off_diagonal`, or a grid for both.
    Matrix,
}

options! {
    /// How the normals of microflakes are distributed. Axes are those of the volume before its
    /// transform, and turn with it.
    #[schemars(extend("allOf" = rules::microflakes()))]
    pub struct MicroflakeSpec {
        /// Kind of distribution.
        required shape: MicroflakeShapeSpec;
        /// The axis, of any length.
        #[schemars(extend("examples" = [[0, 1, 0]]))]
        #[schemars(extend("allOf" = [super::schema_rule::direction()]))]
        axis: [f64; 3];
        /// Grid of vectors with the axis; where it is 0, microflakes are isotropic.
        axis_grid: String;
        /// Area shown along a fibre or across a surface's normal, relative to the largest, 0.001 to
        /// 1.
        #[schemars(extend("examples" = [0.1]))]
        roughness: f64, between(written(pileus_media::microflakes::MIN_ROUGHNESS), 1);
        /// Grid of numbers with the roughness; needs `axis_grid`.
        roughness_grid: String;
        /// Entries xx, yy, zz of the matrix.
        #[schemars(extend("examples" = [[1, 1, 0.01]]))]
        diagonal: [f64; 3], rules::entries;
        /// Entries xy, xz, yz of the matrix; 0 if not given.
        off_diagonal: [f64; 3];
        /// Grid of vectors with xx, yy, zz; where all are 0, microflakes are isotropic.
        diagonal_grid: String;
        /// Grid of vectors with xy, xz, yz; needs `diagonal_grid`.
        off_diagonal_grid: String;
    }
}

impl MicroflakeSpec {
    /// The names of the keys that are given, but for `shape`.
    pub(crate) fn keys(&self) -> impl Iterator<Item = &'static str> {
        let given = [
            ("axis", self.axis.is_some()),
            ("axis_grid", self.axis_grid.is_some()),
            ("roughness", self.roughness.is_some()),
            ("roughness_grid", self.roughness_grid.is_some()),
            ("diagonal", self.diagonal.is_some()),
            ("off_diagonal", self.off_diagonal.is_some()),
            ("diagonal_grid", self.diagonal_grid.is_some()),
            ("off_diagonal_grid", self.off_diagonal_grid.is_some()),
        ];
        given.into_iter().filter(|(_, given)| *given).map(|(key, _)| key)
    }
}
