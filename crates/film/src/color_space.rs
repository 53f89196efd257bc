//! Colour spaces that image files name, and the way from them to linear Rec. 709.

use std::fmt;

/// The custom attribute of OpenEXR that names a colour space (Color Interop Forum, 2024).
pub(crate) const COLOR_INTEROP_ID: &str = "colorInteropID";
/// Value of `colorInteropID` for linear Rec. 709, which all images of this program are in.
pub(crate) const LIN_REC_709: &str = "lin_rec709_scene";

/// CIE 1931 chromaticities (x, y) of three primaries and of white.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chromaticities {
    /// Red.
    pub red: [f64; 2],
    /// Green.
    pub green: [f64; 2],
    /// Blue.
    pub blue: [f64; 2],
    /// The colour of (1, 1, 1).
    pub white: [f64; 2],
}

const D65: [f64; 2] = [0.3127, 0.3290];
const ACES_WHITE: [f64; 2] = [0.32168, 0.33767];

impl Chromaticities {
    /// ITU-R BT.709 with white D65.
    pub const REC_709: Self =
        Self { red: [0.64, 0.33], green: [0.30, 0.60], blue: [0.15, 0.06], white: D65 };
    /// ITU-R BT.2020.
    const REC_2020: Self =
        Self { red: [0.708, 0.292], green: [0.170, 0.797], blue: [0.131, 0.046], white: D65 };
    /// SMPTE EG 432-1 with white D65.
    const P3_D65: Self =
        Self { red: [0.680, 0.320], green: [0.265, 0.690], blue: [0.150, 0.060], white: D65 };
    /// Adobe RGB (1998).
    const ADOBE_RGB: Self =
        Self { red: [0.64, 0.33], green: [0.21, 0.71], blue: [0.15, 0.06], white: D65 };
    /// SMPTE ST 2065-1, ACES2065-1.
    const AP0: Self = Self {
        red: [0.7347, 0.2653],
        green: [0.0, 1.0],
        blue: [0.0001, -0.0770],
        white: ACES_WHITE,
    };
    /// Academy S-2014-004, ACEScg.
    const AP1: Self = Self {
        red: [0.713, 0.293],
        green: [0.165, 0.830],
        blue: [0.128, 0.044],
        white: ACES_WHITE,
    };
    /// From the eight numbers x, y of red, green, blue and white.
    pub fn from_array([rx, ry, gx, gy, bx, by, wx, wy]: [f64; 8]) -> Self {
        Self { red: [rx, ry], green: [gx, gy], blue: [bx, by], white: [wx, wy] }
    }

    /// Whether all coordinates differ by at most 0.0005, a unit of the last digit that standards
    /// and 16-bit writers give them.
    fn is_close_to(&self, other: &Self) -> bool {
        let of = |c: &Self| [c.red, c.green, c.blue, c.white];
        let pairs = of(self).into_iter().flatten().zip(of(other).into_iter().flatten());
        pairs.into_iter().all(|(a, b)| (a - b).abs() <= 5e-4)
    }

    /// The matrix from linear RGB to CIE XYZ, with white at Y = 1: columns are the primaries
    /// (SMPTE RP 177). None if the primaries span no space or white has no luminance.
    fn to_xyz(self) -> Option<Matrix> {
        let xyz = |[x, y]: [f64; 2]| [x, y, 1.0 - x - y];
        let columns = transposed([xyz(self.red), xyz(self.green), xyz(self.blue)]);
        let gains = apply(&inverse(&columns)?, white_xyz(self.white)?);
        let scaled = columns.map(|row| std::array::from_fn(|c| row[c] * gains[c]));
        let sound = gains.iter().all(|g| g.is_finite() && *g > 1e-6);
        sound.then_some(scaled)
    }

    /// The matrix from linear RGB of these primaries to linear Rec. 709; white is adapted to D65
    /// by the Bradford transform (linear, as ICC.1:2022 annex E has it), so that (1, 1, 1) stays
    /// (1, 1, 1). None if the primaries span no space.
    fn to_rec_709(self) -> Option<Matrix> {
        let own = self.to_xyz()?;
        let adapted = product(&bradford(self.white, D65)?, &own);
        let matrix = product(&inverse(&Self::REC_709.to_xyz()?)?, &adapted);
        matrix.iter().flatten().all(|v| v.is_finite()).then_some(matrix)
    }
}

/// How values are encoded.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Transfer {
    Linear,
    /// IEC 61966-2-1.
    Srgb,
    Gamma(f64),
}

impl Transfer {
    /// Light of an encoded value; odd, as colours outside the gamut need it.
    fn decode(self, value: f32) -> f32 {
        let v = f64::from(value.abs());
        let light = match self {
            Self::Linear => return value,
            Self::Srgb if v <= 0.04045 => v / 12.92,
            Self::Srgb => libm::pow((v + 0.055) / 1.055, 2.4),
            Self::Gamma(gamma) => libm::pow(v, gamma),
        };
        (light as f32).copysign(value)
    }
}

/// The colour space that a file says its values are in.
#[derive(Clone, Debug, PartialEq)]
pub struct ColorSpace {
    name: String,
    /// From linear values to linear Rec. 709; none where they are that.
    matrix: Option<Matrix>,
    transfer: Transfer,
}

/// What there is to say about a choice of colour space, for a log.
pub type Remarks = Vec<String>;

impl Default for ColorSpace {
    /// Linear Rec. 709.
    fn default() -> Self {
        Self { name: "linear Rec. 709".into(), matrix: None, transfer: Transfer::Linear }
    }
}

impl fmt::Display for ColorSpace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.name)
    }
}

impl ColorSpace {
    /// Linear RGB of the given primaries; none if they span no colours.
    pub fn of_chromaticities(given: Chromaticities) -> Option<Self> {
        let known = [
            (Chromaticities::REC_709, "linear Rec. 709"),
            (Chromaticities::AP1, "linear AP1 (ACEScg)"),
            (Chromaticities::AP0, "linear AP0 (ACES2065-1)"),
            (Chromaticities::REC_2020, "linear Rec. 2020"),
            (Chromaticities::P3_D65, "linear P3-D65"),
            (Chromaticities::ADOBE_RGB, "linear Adobe RGB"),
        ];
        let Chromaticities { red, green, blue, white } = given;
        let (primaries, name) = match known.iter().find(|(known, _)| given.is_close_to(known)) {
            Some(&(known, name)) => (known, name.to_owned()),
            None => {
                let text = format!("{red:.4?} {green:.4?} {blue:.4?}, white {white:.4?}");
                (given, format!("linear RGB of primaries {text}"))
            }
        };
        let matrix = Some(primaries.to_rec_709()?);
        let matrix = matrix.filter(|_| primaries != Chromaticities::REC_709);
        Some(Self { name, matrix, transfer: Transfer::Linear })
    }

    /// CIE XYZ whose white is that of D65 at Y = 1.
    fn xyz_d65() -> Option<Self> {
        let matrix = inverse(&Chromaticities::REC_709.to_xyz()?);
        let name = "CIE XYZ relative to D65".into();
        Some(Self { name, matrix, transfer: Transfer::Linear })
    }

    /// The space that an identifier of the Color Interop Forum names (`lin_ap1_scene`,
    /// `srgb_rec709_scene`, ...): an encoding, primaries and what the values refer to. None for
    /// identifiers that this program does not know, `data` and `unknown` among them.
    pub fn of_interop_id(id: &str) -> Option<Self> {
        let mut parts = id.split('_');
        let transfer = match parts.next()? {
            "lin" => Transfer::Linear,
            "srgb" => Transfer::Srgb,
            "g18" => Transfer::Gamma(1.8),
            "g22" => Transfer::Gamma(2.2),
            "g24" => Transfer::Gamma(2.4),
            "g26" => Transfer::Gamma(2.6),
            _ => return None,
        };
        let primaries = match parts.next()? {
            "rec709" => Chromaticities::REC_709,
            "rec2020" => Chromaticities::REC_2020,
            "p3d65" => Chromaticities::P3_D65,
            "adobergb" => Chromaticities::ADOBE_RGB,
            "ap0" => Chromaticities::AP0,
            "ap1" => Chromaticities::AP1,
            "ciexyzd65" => return (id == "lin_ciexyzd65_scene").then(Self::xyz_d65).flatten(),
            _ => return None,
        };
        let mut space = Self::of_chromaticities(primaries)?;
        if !matches!(parts.next()?, "scene" | "display") || parts.next().is_some() {
            return None;
        }
        if transfer != Transfer::Linear {
            space.name = id.to_owned();
        }
        space.transfer = transfer;
        Some(space)
    }

    /// The space of an OpenEXR file by its two attributes.
    ///
    /// `colorInteropID` counts where it is known, then `chromaticities`, then linear Rec. 709. What
    /// was not known or contradicts itself is remarked upon.
    pub fn of_exr(id: Option<&str>, chromaticities: Option<Chromaticities>) -> (Self, Remarks) {
        let mut remarks = Remarks::new();
        let by_primaries = chromaticities.and_then(|given| {
            let space = Self::of_chromaticities(given);
            if space.is_none() {
                remarks.push(format!("its chromaticities span no colours: {given:?}"));
            }
            space
        });
        let by_id = id.and_then(|id| {
            let space = Self::of_interop_id(id);
            if space.is_none() && id != "unknown" {
                let instead = by_primaries.clone().unwrap_or_default();
                let id = id.escape_debug();
                remarks.push(format!(
                    "its {COLOR_INTEROP_ID} \"{id}\" is not known, values are taken as {instead}"
                ));
            }
            space
        });
        if let (Some(a), Some(b)) = (&by_id, &by_primaries)
            && a.matrix != b.matrix
        {
            remarks.push(format!(
                "its {COLOR_INTEROP_ID} says {a}, its chromaticities say {b}: the former counts"
            ));
        }
        (by_id.or(by_primaries).unwrap_or_default(), remarks)
    }

    /// Whether values need no conversion.
    pub fn is_linear_rec_709(&self) -> bool {
        self.transfer == Transfer::Linear && self.matrix.is_none()
    }

    /// Converts pixels to linear Rec. 709, white adapted to D65 by Bradford's transform.
    ///
    /// Colours outside the gamut of Rec. 709 get negative values. Linear Rec. 709 stays bit for
    /// bit.
    pub fn convert_to_rec_709(&self, pixels: &mut [[f32; 3]]) {
        if self.transfer != Transfer::Linear {
            for value in pixels.iter_mut().flatten() {
                *value = self.transfer.decode(*value);
            }
        }
        if let Some(matrix) = &self.matrix {
            for pixel in pixels {
                *pixel = apply(matrix, pixel.map(f64::from)).map(|v| v as f32);
            }
        }
    }
}

type Matrix = [[f64; 3]; 3];

fn apply(m: &Matrix, v: [f64; 3]) -> [f64; 3] {
    m.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

fn transposed(m: Matrix) -> Matrix {
    std::array::from_fn(|r| std::array::from_fn(|c| m[c][r]))
}

fn product(a: &Matrix, b: &Matrix) -> Matrix {
    transposed(transposed(*b).map(|column| apply(a, column)))
}

fn inverse(m: &Matrix) -> Option<Matrix> {
    let cofactor = |r: usize, c: usize| {
        let (r1, r2, c1, c2) = ((r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3);
        m[r1][c1] * m[r2][c2] - m[r1][c2] * m[r2][c1]
    };
    let determinant: f64 = (0..3).map(|c| m[0][c] * cofactor(0, c)).sum();
    let sound = determinant.is_finite() && determinant.abs() > 1e-9;
    sound.then(|| std::array::from_fn(|r| std::array::from_fn(|c| cofactor(c, r) / determinant)))
}

/// XYZ of a white of luminance 1.
fn white_xyz([x, y]: [f64; 2]) -> Option<[f64; 3]> {
    let xyz = [x / y, 1.0, (1.0 - x - y) / y];
    (y > 1e-6 && xyz.iter().all(|v| v.is_finite())).then_some(xyz)
}

/// The Bradford transform between two whites: cone responses (Lam 1985) are scaled one by one.
fn bradford(from: [f64; 2], to: [f64; 2]) -> Option<Matrix> {
    const CONES: Matrix =
        [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]];
    let [source, target] = [from, to].map(|white| white_xyz(white).map(|xyz| apply(&CONES, xyz)));
    let (source, target) = (source?, target?);
    let scaled: Matrix =
        std::array::from_fn(|r| CONES[r].map(|value| value * target[r] / source[r]));
    Some(product(&inverse(&CONES)?, &scaled))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn converted(space: &ColorSpace, pixel: [f32; 3]) -> [f32; 3] {
        let mut pixels = [pixel];
        space.convert_to_rec_709(&mut pixels);
        pixels[0]
    }

    fn close(a: [f32; 3], b: [f32; 3], tolerance: f32) {
        assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() <= tolerance), "{a:?} {b:?}");
    }

    #[test]
    fn acescg_becomes_rec_709_as_other_programs_have_it() {
        // What Blender 5.3, by OpenColorIO, makes of it.
        let expected = [1.3525, 0.4349, 0.4880];
        let named = ColorSpace::of_interop_id("lin_ap1_scene").unwrap();
        close(converted(&named, [1.0, 0.5, 0.5]), expected, 1e-4);
        // A file's numbers are of 32 bits.
        let file = [0.713f32, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767];
        let (space, remarks) =
            ColorSpace::of_exr(None, Some(Chromaticities::from_array(file.map(f64::from))));
        assert_eq!((space, remarks), (named, Remarks::new()));
    }

    #[test]
    fn white_stays_white_and_matrices_are_those_of_the_standards() {
        for id in [
            "lin_ap0_scene",
            "lin_ap1_scene",
            "lin_rec709_scene",
            "lin_rec2020_scene",
            "lin_p3d65_scene",
            "lin_adobergb_scene",
            "srgb_ap1_scene",
            "g22_adobergb_scene",
        ] {
            let space = ColorSpace::of_interop_id(id).unwrap();
            close(converted(&space, [1.0; 3]), [1.0; 3], 1e-6);
        }
        // ITU-R BT.2087-0, table of the matrix from BT.2020 to BT.709.
        let wide = ColorSpace::of_interop_id("lin_rec2020_scene").unwrap();
        close(converted(&wide, [1.0, 0.0, 0.0]), [1.6605, -0.1246, -0.0182], 1e-4);
        close(converted(&wide, [0.0, 1.0, 0.0]), [-0.5876, 1.1329, -0.1006], 1e-4);
        // IEC 61966-2-1: XYZ of D65 is white, and the luminance of green is .7152.
        let xyz = ColorSpace::of_interop_id("lin_ciexyzd65_scene").unwrap();
        close(converted(&xyz, [0.9505, 1.0, 1.0891]), [1.0; 3], 2e-3);
        close(converted(&xyz, [0.3576, 0.7152, 0.1192]), [0.0, 1.0, 0.0], 2e-3);
        // sRGB's curve.
        let srgb = ColorSpace::of_interop_id("srgb_rec709_scene").unwrap();
        close(converted(&srgb, [0.5, -0.5, 0.02]), [0.214_041, -0.214_041, 0.001_548], 1e-6);
    }

    #[test]
    fn rec_709_stays_bit_for_bit() {
        let pixel = [0.1, 1e30, -3.0];
        for (id, chromaticities) in [
            (None, None),
            (Some("lin_rec709_scene"), None),
            (None, Some(Chromaticities::REC_709)),
            (Some("unknown"), None),
        ] {
            let (space, remarks) = ColorSpace::of_exr(id, chromaticities);
            assert!(space.is_linear_rec_709() && remarks.is_empty());
            assert_eq!(converted(&space, pixel), pixel);
        }
    }

    #[test]
    fn what_is_not_known_or_contradicts_itself_is_remarked_upon() {
        let (space, remarks) = ColorSpace::of_exr(Some("ocio:log_wide"), Some(Chromaticities::AP1));
        assert_eq!(space.to_string(), "linear AP1 (ACEScg)");
        assert!(remarks[0].contains("\"ocio:log_wide\" is not known"), "{remarks:?}");
        let (space, remarks) =
            ColorSpace::of_exr(Some("lin_ap1_scene"), Some(Chromaticities::REC_709));
        assert_eq!(space.to_string(), "linear AP1 (ACEScg)");
        assert!(remarks[0].contains("the former counts"), "{remarks:?}");
        let nothing = Chromaticities::from_array([0.3; 8]);
        let odd = Chromaticities::from_array([f64::NAN; 8]);
        let dark = Chromaticities { white: [0.3, 0.0], ..Chromaticities::REC_709 };
        for broken in [nothing, odd, dark] {
            let (space, remarks) = ColorSpace::of_exr(None, Some(broken));
            assert!(space.is_linear_rec_709() && remarks.len() == 1, "{remarks:?}");
        }
        for id in ["", "lin", "lin_ap1", "lin_ap1_scene_x", "lin_ap9_scene", "data", "raw"] {
            assert!(ColorSpace::of_interop_id(id).is_none(), "{id}");
        }
    }
}
