//! Where a grid lies in space: the linear maps of OpenVDB as one matrix.

use crate::cursor::Cursor;
use crate::error::{Error, Fault, Place, shown};

/// Which map the file names. All but the frustum are affine.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(missing_docs, reason = "the variants are named as OpenVDB names its maps")]
pub enum TransformKind {
    UniformScale,
    Scale,
    UniformScaleTranslate,
    ScaleTranslate,
    Translation,
    Unitary,
    Affine,
    /// A perspective map, which is read over but not evaluated.
    Frustum,
}

impl TransformKind {
    /// The name that OpenVDB writes into the file, `AffineMap` for instance.
    pub fn map_name(self) -> &'static str {
        match self {
            TransformKind::UniformScale => "UniformScaleMap",
            TransformKind::Scale => "ScaleMap",
            TransformKind::UniformScaleTranslate => "UniformScaleTranslateMap",
            TransformKind::ScaleTranslate => "ScaleTranslateMap",
            TransformKind::Translation => "TranslationMap",
            TransformKind::Unitary => "UnitaryMap",
            TransformKind::Affine => "AffineMap",
            TransformKind::Frustum => "NonlinearFrustumMap",
        }
    }

    fn from_map_name(name: &str) -> Option<TransformKind> {
        [
            TransformKind::UniformScale,
            TransformKind::Scale,
            TransformKind::UniformScaleTranslate,
            TransformKind::ScaleTranslate,
            TransformKind::Translation,
            TransformKind::Unitary,
            TransformKind::Affine,
            TransformKind::Frustum,
        ]
        .into_iter()
        .find(|kind| kind.map_name() == name)
    }
}

/// The map from index space (voxels) to world space (the units of the file) of a grid.
#[derive(Debug, Clone)]
pub struct Transform {
    kind: TransformKind,
    matrix: [[f64; 4]; 4],
    place: Place,
}

impl PartialEq for Transform {
    fn eq(&self, other: &Transform) -> bool {
        self.kind == other.kind && self.matrix == other.matrix
    }
}

const IDENTITY: [[f64; 4]; 4] =
    [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];

fn scale_translate(scale: [f64; 3], translation: [f64; 3]) -> [[f64; 4]; 4] {
    let mut matrix = IDENTITY;
    for (axis, (row, factor)) in matrix.iter_mut().zip(scale).enumerate() {
        row[axis] = factor;
    }
    matrix[3][..3].copy_from_slice(&translation);
    matrix
}

impl Transform {
    /// The affine map of a matrix: row-major, for row vectors, so `world = [i, j, k, 1] * matrix`
    /// and the translation is the last row.
    pub fn from_matrix(matrix: [[f64; 4]; 4]) -> Transform {
        let place = Place { file: "(memory)".into(), grid: None, offset: None };
        Transform { kind: TransformKind::Affine, matrix, place }
    }

    /// Which map the file names.
    pub fn kind(&self) -> TransformKind {
        self.kind
    }

    /// The matrix from index to world space, row-major, for row vectors:
    /// `world = [i, j, k, 1] * matrix`.
    ///
    /// # Errors
    /// [`Error::Unsupported`] for a frustum, which no matrix can express.
    pub fn matrix(&self) -> Result<[[f64; 4]; 4], Error> {
        if self.kind == TransformKind::Frustum {
            return Err(Error::Unsupported {
                place: self.place.clone(),
                what: "the transform is a frustum (NonlinearFrustumMap), which is not linear"
                    .into(),
                remedy: "resample the grid onto a uniform or affine transform",
            });
        }
        Ok(self.matrix)
    }

    /// Same as [`Transform::matrix`]: from voxels to world units.
    ///
    /// # Errors
    /// [`Error::Unsupported`] for a frustum.
    pub fn index_to_world(&self) -> Result<[[f64; 4]; 4], Error> {
        self.matrix()
    }

    /// The inverse matrix, from world units to voxels, in the same convention.
    ///
    /// # Errors
    /// [`Error::Unsupported`] for a frustum, [`Error::Invalid`] when the matrix has no finite
    /// inverse.
    pub fn world_to_index(&self) -> Result<[[f64; 4]; 4], Error> {
        invert_affine(&self.matrix()?).ok_or_else(|| Error::Invalid {
            place: self.place.clone(),
            what: format!("the transform {} is singular: {:?}", self.kind.map_name(), self.matrix),
            remedy: "give the grid a transform whose three axes are finite and independent",
        })
    }

    /// Edge lengths of a voxel in world units (lengths of the matrix rows).
    ///
    /// # Errors
    /// [`Error::Unsupported`] for a frustum.
    pub fn voxel_size(&self) -> Result<[f64; 3], Error> {
        let [x, y, z, _] = self.matrix()?;
        Ok([x, y, z].map(|[a, b, c, _]| a.hypot(b).hypot(c)))
    }

    pub(crate) fn place(&self) -> Place {
        self.place.clone()
    }

    pub(crate) fn name_place(&mut self, file: &str, grid: &str) {
        self.place.file = file.into();
        self.place.grid = Some(grid.into());
    }

    /// Reads the map's name and its numbers. `version` is that of the file format.
    pub(crate) fn read(cursor: &mut Cursor<'_>, version: u32) -> Result<Transform, Fault> {
        let start = cursor.offset();
        let (kind, matrix) = read_map(cursor)?;
        if kind == TransformKind::Frustum {
            // Box of the frustum (whole numbers before version 221), taper, depth, then the map of
            // its near plane.
            let bytes = if version < 221 { 6 * 4 } else { 6 * 8 } + 2 * 8;
            cursor.take(bytes, "a frustum map")?;
            let second = cursor.offset();
            if read_map(cursor)?.0 == TransformKind::Frustum {
                return Err(Fault::invalid(second, "a frustum map contains another"));
            }
        }
        let place = Place { file: String::new(), grid: None, offset: Some(start) };
        Ok(Transform { kind, matrix, place })
    }
}

fn read_map(cursor: &mut Cursor<'_>) -> Result<(TransformKind, [[f64; 4]; 4]), Fault> {
    let start = cursor.offset();
    let name = cursor.string("the name of the transform")?;
    let Some(kind) = TransformKind::from_map_name(&name) else {
        return Err(Fault::unsupported(
            start,
            format!("the transform has the unknown type \"{}\"", shown(&name)),
            "resample the grid onto a uniform or affine transform",
        ));
    };
    let matrix = match kind {
        TransformKind::UniformScale | TransformKind::Scale => {
            let scale = cursor.f64s("a scale map")?;
            cursor.f64s::<12>("a scale map")?; // voxel size, inverse, two derived triples
            scale_translate(scale, [0.0; 3])
        }
        TransformKind::UniformScaleTranslate | TransformKind::ScaleTranslate => {
            let translation = cursor.f64s("a scale and translation map")?;
            let scale = cursor.f64s("a scale and translation map")?;
            cursor.f64s::<12>("a scale and translation map")?;
            scale_translate(scale, translation)
        }
        TransformKind::Translation => scale_translate([1.0; 3], cursor.f64s("a translation map")?),
        TransformKind::Unitary | TransformKind::Affine => {
            let start = cursor.offset();
            let mut matrix = [[0.0; 4]; 4];
            for row in &mut matrix {
                *row = cursor.f64s("an affine map")?;
            }
            if matrix.map(|row| row[3]) != [0.0, 0.0, 0.0, 1.0] {
                if matrix[3] == [0.0, 0.0, 0.0, 1.0] {
                    return Err(Fault::invalid_with(
                        start,
                        "the matrix of the transform has its translation in the last column: it is \
                         written for column vectors; OpenVDB's are rows",
                        "write the grid again with the matrix transposed, or without rotation",
                    ));
                }
                return Err(Fault::invalid(start, "the matrix of the transform is not affine"));
            }
            matrix
        }
        TransformKind::Frustum => IDENTITY,
    };
    Ok((kind, matrix))
}

/// Inverse by cofactors of the 3 x 3 part; none if it is singular or not finite.
fn invert_affine(m: &[[f64; 4]; 4]) -> Option<[[f64; 4]; 4]> {
    let cofactor = |r: usize, c: usize| {
        let (r1, r2, c1, c2) = ((r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3);
        m[r1][c1] * m[r2][c2] - m[r1][c2] * m[r2][c1]
    };
    let determinant: f64 = (0..3).map(|c| m[0][c] * cofactor(0, c)).sum();
    let rows: [[f64; 3]; 3] =
        std::array::from_fn(|r| std::array::from_fn(|c| cofactor(c, r) / determinant));
    let shift: [f64; 3] =
        std::array::from_fn(|c| -(0..3).map(|r| m[3][r] * rows[r][c]).sum::<f64>());
    let row = |[x, y, z]: [f64; 3], w| [x, y, z, w];
    let inverse = [row(rows[0], 0.0), row(rows[1], 0.0), row(rows[2], 0.0), row(shift, 1.0)];
    inverse.iter().flatten().all(|value| value.is_finite()).then_some(inverse)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file_of(name: &str, numbers: &[f64]) -> Vec<u8> {
        let mut bytes = (name.len() as u32).to_le_bytes().to_vec();
        bytes.extend(name.as_bytes());
        bytes.extend(numbers.iter().flat_map(|x| x.to_le_bytes()));
        bytes
    }

    fn read(bytes: &[u8]) -> Result<Transform, Fault> {
        Transform::read(&mut Cursor::new(bytes, 0), 224)
    }

    #[test]
    fn every_linear_map_gives_its_matrix() {
        let mut scale = [0.0; 15];
        scale[..3].copy_from_slice(&[2.0, 3.0, 4.0]);
        for name in ["ScaleMap", "UniformScaleMap"] {
            let transform = read(&file_of(name, &scale)).unwrap();
            assert_eq!(transform.matrix().unwrap(), scale_translate([2.0, 3.0, 4.0], [0.0; 3]));
            assert_eq!(transform.kind().map_name(), name);
        }
        let mut numbers = vec![5.0, 6.0, 7.0];
        numbers.extend(scale);
        for name in ["ScaleTranslateMap", "UniformScaleTranslateMap"] {
            let transform = read(&file_of(name, &numbers)).unwrap();
            let expected = [
                [2.0, 0.0, 0.0, 0.0],
                [0.0, 3.0, 0.0, 0.0],
                [0.0, 0.0, 4.0, 0.0],
                [5.0, 6.0, 7.0, 1.0],
            ];
            assert_eq!(transform.matrix().unwrap(), expected);
        }
        let transform = read(&file_of("TranslationMap", &[5.0, 6.0, 7.0])).unwrap();
        assert_eq!(transform.matrix().unwrap()[3], [5.0, 6.0, 7.0, 1.0]);
        assert_eq!(transform.matrix().unwrap()[..3], IDENTITY[..3]);
        let turn =
            [0.0, 1.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
        for name in ["UnitaryMap", "AffineMap"] {
            let matrix = read(&file_of(name, &turn)).unwrap().matrix().unwrap();
            assert_eq!(matrix.concat(), turn);
        }
    }

    #[test]
    fn the_inverse_undoes_the_matrix() {
        let matrix = [
            [0.3, -0.1, 0.2, 0.0],
            [0.05, 0.4, -0.2, 0.0],
            [-0.3, 0.1, 0.7, 0.0],
            [5.0, -6.0, 7.5, 1.0],
        ];
        let inverse = Transform::from_matrix(matrix).world_to_index().unwrap();
        for r in 0..4 {
            for c in 0..4 {
                let value: f64 = (0..4).map(|k| matrix[r][k] * inverse[k][c]).sum();
                assert!((value - IDENTITY[r][c]).abs() < 1e-12);
            }
        }
        let flat = Transform::from_matrix(scale_translate([1.0, 0.0, 1.0], [0.0; 3]));
        assert!(flat.world_to_index().unwrap_err().to_string().contains("singular"));
    }

    #[test]
    fn a_frustum_is_refused_by_name_but_read_over() {
        let mut bytes = file_of("NonlinearFrustumMap", &[0.0; 8]);
        bytes.extend(file_of("TranslationMap", &[1.0, 2.0, 3.0]));
        let mut cursor = Cursor::new(&bytes, 0);
        let transform = Transform::read(&mut cursor, 224).unwrap();
        assert_eq!(cursor.remaining(), 0);
        let text = transform.matrix().unwrap_err().to_string();
        assert!(text.contains("frustum") && text.contains("NonlinearFrustumMap"));
        assert!(transform.world_to_index().is_err());
    }

    #[test]
    fn unknown_and_projective_maps_are_errors() {
        assert!(read(&file_of("QuadraticMap", &[0.0; 16])).is_err());
        assert!(read(&file_of("AffineMap", &[1.0; 16])).is_err());
    }

    #[test]
    fn a_matrix_for_column_vectors_is_named() {
        // A turn about z and a translation by (1, 2, 3), transposed.
        let turned =
            [0.0, -1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 2.0, 0.0, 0.0, 1.0, 3.0, 0.0, 0.0, 0.0, 1.0];
        let error = read(&file_of("AffineMap", &turned)).unwrap_err().into_error("a.vdb", None);
        let text = error.to_string();
        assert!(matches!(error, Error::Invalid { .. }));
        assert!(text.contains("for column vectors; OpenVDB's are rows"), "{text}");
        assert!(text.contains("transposed") && !text.contains("damaged"), "{text}");
    }
}
