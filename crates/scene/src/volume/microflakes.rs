//! From what a user wrote about microflakes to their distribution.

use glam::{DAffine3, Vec3};
use pileus_media::microflakes::{MIN_ROUGHNESS, MicroflakeGrid, MicroflakeShape, Roughness, Sggx};
use pileus_vdb::Tree;

use crate::error::{Error, Place};
use crate::spec::microflake_spec::{MicroflakeShapeSpec, MicroflakeSpec};
use crate::spec::option::written;

/// Where the specification is, in a volume.
pub(crate) const POINTER: &str = "/phase/distribution";

/// The grids of a volume's file, with the map from the index space of its density to theirs. Keys
/// are for errors.
pub(crate) trait MicroflakeGrids {
    /// A grid of vectors.
    fn vectors(&mut self, name: &str, key: &str) -> Result<(Tree<[f32; 3]>, DAffine3), Error>;
    /// A grid of numbers.
    fn numbers(&mut self, name: &str, key: &str) -> Result<(Tree<f32>, DAffine3), Error>;
}

/// The distribution that a specification describes; `grids`: none in homogeneous volumes.
pub(crate) fn shape(
    spec: &MicroflakeSpec,
    place: &dyn Fn(&str) -> Place,
    grids: Option<&mut dyn MicroflakeGrids>,
) -> Result<MicroflakeShape, Error> {
    let at = |key: &str| place(&format!("{POINTER}/{key}"));
    let along = ["axis", "axis_grid", "roughness", "roughness_grid"].as_slice();
    let matrix = ["diagonal", "off_diagonal", "diagonal_grid", "off_diagonal_grid"].as_slice();
    let own = match spec.shape {
        MicroflakeShapeSpec::Isotropic => &[],
        MicroflakeShapeSpec::Fibre | MicroflakeShapeSpec::Surface => along,
        MicroflakeShapeSpec::Matrix => matrix,
    };
    if let Some(key) = spec.keys().find(|key| !own.contains(key)) {
        return Err(Error::invalid(
            at(key),
            format!("`{key}` does not belong to this shape"),
            "remove it, or choose another `shape`",
        ));
    }
    for (value, grid) in [
        ("axis", "axis_grid"),
        ("roughness", "roughness_grid"),
        ("diagonal", "diagonal_grid"),
        ("off_diagonal", "off_diagonal_grid"),
    ] {
        if spec.keys().any(|key| key == value) && spec.keys().any(|key| key == grid) {
            return Err(Error::invalid(
                at(grid),
                format!("`{value}` and `{grid}` each say the same"),
                "keep one of them",
            ));
        }
    }
    let (by_grid, grids) = match (spec.keys().find(|key| key.ends_with("_grid")), grids) {
        (Some(key), None) => {
            return Err(Error::unsupported(
                at(key),
                "microflakes by grid are possible in volumes with `vdb`",
                "give numbers",
            ));
        }
        (by_grid, grids) => (by_grid.is_some(), grids),
    };
    match (spec.shape, grids.filter(|_| by_grid)) {
        (MicroflakeShapeSpec::Isotropic, _) => Ok(MicroflakeShape::Constant(Sggx::ISOTROPIC)),
        (MicroflakeShapeSpec::Matrix, None) => constant_matrix(spec, &at),
        (MicroflakeShapeSpec::Matrix, Some(grids)) => matrix_grids(spec, &at, grids),
        (_, grids) => fibres_or_surfaces(spec, &at, grids),
    }
}

fn missing(place: Place, key: &str, remedy: &str) -> Error {
    Error::invalid(place, format!("`{key}` is missing"), remedy)
}

fn constant_matrix(
    spec: &MicroflakeSpec,
    at: &dyn Fn(&str) -> Place,
) -> Result<MicroflakeShape, Error> {
    let single = |v: [f64; 3]| v.map(|entry| entry as f32);
    let diagonal = spec
        .diagonal
        .ok_or_else(|| missing(at("shape"), "diagonal", "add the entries xx, yy, zz"))?;
    let off_diagonal = spec.off_diagonal.unwrap_or_default();
    Sggx::new(single(diagonal), single(off_diagonal)).map(MicroflakeShape::Constant).ok_or_else(
        || {
            Error::invalid(
                at("diagonal"),
                "the matrix has a negative eigenvalue, or is zero",
                "give the entries xx, yy, zz and xy, xz, yz of a positive matrix",
            )
        },
    )
}

fn matrix_grids(
    spec: &MicroflakeSpec,
    at: &dyn Fn(&str) -> Place,
    grids: &mut dyn MicroflakeGrids,
) -> Result<MicroflakeShape, Error> {
    let (Some(diagonal), Some(off_diagonal)) = (&spec.diagonal_grid, &spec.off_diagonal_grid)
    else {
        return Err(missing(
            at("shape"),
            "diagonal_grid` or `off_diagonal_grid",
            "name a grid for both, or give both as numbers",
        ));
    };
    let (entries, map) = grids.vectors(diagonal, "diagonal_grid")?;
    let (off, off_map) = grids.vectors(off_diagonal, "off_diagonal_grid")?;
    if map != off_map {
        return Err(Error::unsupported(
            at("off_diagonal_grid"),
            "the grids of the matrix differ in their transforms",
            "write both with one transform",
        ));
    }
    let grid = MicroflakeGrid::from_entries(&entries, &off, map);
    grid.map(|grid| MicroflakeShape::Grid(Box::new(grid)))
        .map_err(|source| Error::medium(at("diagonal_grid"), source))
}

fn fibres_or_surfaces(
    spec: &MicroflakeSpec,
    at: &dyn Fn(&str) -> Place,
    grids: Option<&mut dyn MicroflakeGrids>,
) -> Result<MicroflakeShape, Error> {
    let least = written(MIN_ROUGHNESS);
    let roughness = match spec.roughness {
        Some(roughness) if !(least..=1.0).contains(&roughness) => {
            return Err(Error::invalid(
                at("roughness"),
                format!("the roughness is {roughness}"),
                "give a number between 0.001 and 1",
            ));
        }
        Some(roughness) => Some(roughness as f32),
        None if spec.roughness_grid.is_none() => {
            return Err(missing(at("shape"), "roughness", "add a number between 0.001 and 1"));
        }
        None => None,
    };
    let fibre = spec.shape == MicroflakeShapeSpec::Fibre;
    if let (Some(name), Some(grids)) = (&spec.axis_grid, grids) {
        let medium = |key: &str, source| Error::medium(at(key), source);
        let roughness = match (roughness, &spec.roughness_grid) {
            (None, Some(name)) => {
                let (tree, map) = grids.numbers(name, "roughness_grid")?;
                Roughness::from_tree(&tree, map).map_err(|e| medium("roughness_grid", e))?
            }
            (roughness, _) => Roughness::Constant(roughness.unwrap_or(1.0)),
        };
        let (tree, map) = grids.vectors(name, "axis_grid")?;
        let make = if fibre { MicroflakeGrid::fibres } else { MicroflakeGrid::surfaces };
        let grid = make(&tree, roughness, map).map_err(|e| medium("axis_grid", e))?;
        return Ok(MicroflakeShape::Grid(Box::new(grid)));
    }
    let Some(roughness) = roughness else {
        return Err(Error::unsupported(
            at("roughness_grid"),
            "a grid of roughness needs a grid of axes",
            "write the axis into a grid as well, and name it with `axis_grid`",
        ));
    };
    let axis = spec.axis.ok_or_else(|| missing(at("shape"), "axis", "add a vector"))?;
    let axis = Vec3::from_array(axis.map(|v| v as f32))
        .try_normalize()
        .ok_or_else(|| Error::invalid(at("axis"), "the axis has no direction", "give a vector"))?;
    let of = if fibre { Sggx::fibre } else { Sggx::surface };
    Ok(MicroflakeShape::Constant(of(axis, roughness)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<MicroflakeShape, Error> {
        let spec: MicroflakeSpec = serde_json::from_str(text).unwrap();
        shape(&spec, &|pointer| Place::file(pointer), None)
    }

    #[test]
    fn shapes_are_read() {
        for (text, along, across) in [
            (r#"{"shape":"isotropic"}"#, 1.0, 1.0),
            (r#"{"shape":"fibre","axis":[0,0,3],"roughness":0.2}"#, 0.2, 1.0),
            (r#"{"shape":"surface","axis":[0,0,-1],"roughness":0.3}"#, 1.0, 0.3),
            (r#"{"shape":"matrix","diagonal":[4,4,1]}"#, 1.0, 2.0),
            (r#"{"shape":"matrix","diagonal":[1,1,2],"off_diagonal":[0,1,0]}"#, 2f32.sqrt(), 1.0),
        ] {
            let MicroflakeShape::Constant(s) = read(text).unwrap() else { panic!("{text}") };
            assert!((s.projected_area(Vec3::Z) - along).abs() < 1e-4, "{text}");
            assert!((s.projected_area(Vec3::Y) - across).abs() < 1e-4, "{text}");
        }
    }

    #[test]
    fn faults_are_placed() {
        for (text, key) in [
            (r#"{"shape":"isotropic","axis":[0,1,0]}"#, "axis"),
            (r#"{"shape":"fibre","axis":[0,1,0]}"#, "shape"),
            (r#"{"shape":"fibre","roughness":0.1}"#, "shape"),
            (r#"{"shape":"fibre","axis":[0,0,0],"roughness":0.1}"#, "axis"),
            (r#"{"shape":"fibre","axis":[0,1,0],"roughness":0}"#, "roughness"),
            (r#"{"shape":"fibre","axis_grid":"a","roughness":0.1}"#, "axis_grid"),
            (r#"{"shape":"fibre","axis":[0,1,0],"axis_grid":"a","roughness":1}"#, "axis_grid"),
            (r#"{"shape":"surface","axis":[0,1,0],"roughness_grid":"r"}"#, "roughness_grid"),
            (r#"{"shape":"matrix"}"#, "shape"),
            (r#"{"shape":"matrix","diagonal":[1,1,-1]}"#, "diagonal"),
            (r#"{"shape":"matrix","diagonal":[1,1,1],"off_diagonal":[2,0,0]}"#, "diagonal"),
        ] {
            let said = read(text).unwrap_err().to_string();
            assert!(said.contains(&format!("{POINTER}/{key}")), "{text}: {said}");
        }
    }
}
