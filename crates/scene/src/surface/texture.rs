//! Images on surfaces: decoding, wrapping, filtering.

use std::sync::{Arc, LazyLock};

use glam::{Mat2, Vec2, Vec4};
use pileus_math::elementary::{exp, ln};

/// The texels of an image, row by row from the top.
#[derive(Debug, Clone)]
pub(crate) enum Texels {
    /// Eight bits a channel; colours are sRGB if `srgb`, else all is linear.
    Eight { texels: Vec<[u8; 4]>, srgb: bool },
    /// Sixteen bits a channel, linear.
    Sixteen(Vec<[u16; 4]>),
}

/// An image of at least one texel.
#[derive(Debug, Clone)]
pub(crate) struct Image {
    width: u32,
    height: u32,
    texels: Texels,
}

/// How coordinates outside [0, 1] are brought back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Wrap {
    Repeat,
    Mirror,
    Clamp,
}

/// A texture as a slot of a material sees it.
#[derive(Debug, Clone)]
pub(crate) struct Texture {
    pub(crate) image: Arc<Image>,
    pub(crate) wrap: [Wrap; 2],
    /// Nearest texel instead of bilinear interpolation.
    pub(crate) nearest: bool,
    /// Which set of coordinates it uses, 0 or 1.
    pub(crate) set: usize,
    /// `KHR_texture_transform`: coordinates are multiplied by this and moved by `offset`.
    pub(crate) matrix: Mat2,
    pub(crate) offset: Vec2,
}

/// sRGB's transfer function for eight bits (IEC 61966-2-1).
static SRGB: LazyLock<[f32; 256]> =
    LazyLock::new(|| std::array::from_fn(|i| srgb_to_linear(i as f32 / 255.0)));

/// Linear value of an sRGB value in [0, 1].
pub(crate) fn srgb_to_linear(value: f32) -> f32 {
    if value <= 0.04045 { value / 12.92 } else { exp(2.4 * ln((value + 0.055) / 1.055)).min(1.0) }
}

impl Image {
    /// `None` unless there are `width` times `height` texels, and at least one.
    pub(crate) fn new(width: u32, height: u32, texels: Texels) -> Option<Self> {
        let count = match &texels {
            Texels::Eight { texels, .. } => texels.len(),
            Texels::Sixteen(texels) => texels.len(),
        };
        let expected = u64::from(width) * u64::from(height);
        (count as u64 == expected && count > 0).then_some(Self { width, height, texels })
    }

    pub(crate) fn size(&self) -> [u32; 2] {
        [self.width, self.height]
    }

    /// A texel, linear; the last one for places outside.
    #[inline]
    pub(crate) fn texel(&self, x: u32, y: u32) -> Vec4 {
        let at =
            y.min(self.height - 1) as usize * self.width as usize + x.min(self.width - 1) as usize;
        match &self.texels {
            Texels::Eight { texels, srgb } => {
                let texel = texels.get(at).copied().unwrap_or_default();
                let linear = texel.map(|c| f32::from(c) / 255.0);
                if !srgb {
                    return Vec4::from_array(linear);
                }
                let [r, g, b, _] = texel.map(|c| SRGB[usize::from(c)]);
                Vec4::new(r, g, b, linear[3])
            }
            Texels::Sixteen(texels) => {
                let texel = texels.get(at).copied().unwrap_or_default();
                Vec4::from_array(texel.map(|c| f32::from(c) / 65535.0))
            }
        }
    }
}

impl Wrap {
    /// The texel in a row of `size` that stands at place `i`.
    #[inline]
    fn texel(self, i: i64, size: u32) -> u32 {
        let n = i64::from(size);
        let wrapped = match self {
            Self::Repeat => i.rem_euclid(n),
            Self::Mirror => {
                let twice = i.rem_euclid(2 * n);
                twice.min(2 * n - 1 - twice)
            }
            Self::Clamp => i.clamp(0, n - 1),
        };
        wrapped as u32
    }
}

impl Texture {
    /// Coordinates of the image for those of the mesh.
    #[inline]
    pub(crate) fn place(&self, uv: &[Vec2; 2]) -> Vec2 {
        self.matrix * uv[self.set] + self.offset
    }

    /// How `KHR_texture_transform` turns the frame of a normal map: the direction on the surface in
    /// which the image's first coordinate grows while its second stays, as multiples of those in
    /// which the mesh's coordinates grow, and -1 if the transform mirrors. `None` if neither
    /// changes, or if the transform leaves no area.
    pub(crate) fn turned_frame(&self) -> Option<([f32; 2], f32)> {
        let [x, y] = self.matrix.to_cols_array_2d();
        let determinant = self.matrix.determinant();
        if determinant == 0.0 || x[1] == 0.0 && x[0] > 0.0 && determinant > 0.0 {
            return None;
        }
        // The first column of the inverse, without the size of the determinant.
        let flip = determinant.signum();
        Some(([flip * y[1], -flip * x[1]], flip))
    }

    /// The value at coordinates of the mesh, linear: (0, 0) is the outer corner of the first texel.
    #[inline]
    pub(crate) fn eval(&self, uv: &[Vec2; 2]) -> Vec4 {
        self.at(self.place(uv))
    }

    /// The value at coordinates of the image.
    pub(crate) fn at(&self, uv: Vec2) -> Vec4 {
        let [width, height] = self.image.size();
        // In double precision, so that texels far from the origin keep their places; what is not
        // a number becomes 0.
        let x = f64::from(uv.x) * f64::from(width);
        let y = f64::from(uv.y) * f64::from(height);
        let wrap = |x: i64, y: i64| {
            self.image.texel(self.wrap[0].texel(x, width), self.wrap[1].texel(y, height))
        };
        // Casts saturate; a quarter of the range leaves room for a neighbour.
        let whole = |v: f64| (v.floor() as i64).clamp(i64::MIN / 4, i64::MAX / 4);
        if self.nearest {
            return wrap(whole(x), whole(y));
        }
        let (x, y) = (x - 0.5, y - 0.5);
        let (left, top) = (whole(x), whole(y));
        let share = |v: f64, low: i64| {
            let share = (v - low as f64) as f32;
            if (0.0..=1.0).contains(&share) { share } else { 0.0 }
        };
        let (fx, fy) = (share(x, left), share(y, top));
        let row = |y: i64| wrap(left, y) * (1.0 - fx) + wrap(left + 1, y) * fx;
        row(top) * (1.0 - fy) + row(top + 1) * fy
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// An image of linear bytes in the first channel, others 255.
    pub(crate) fn image(width: u32, values: &[u8]) -> Arc<Image> {
        let texels = values.iter().map(|&v| [v, 255, 255, 255]).collect();
        let height = values.len() as u32 / width;
        let texels = Texels::Eight { texels, srgb: false };
        Arc::new(Image::new(width, height, texels).unwrap())
    }

    pub(crate) fn texture(image: Arc<Image>, wrap: Wrap) -> Texture {
        Texture {
            image,
            wrap: [wrap; 2],
            nearest: false,
            set: 0,
            matrix: Mat2::IDENTITY,
            offset: Vec2::ZERO,
        }
    }

    fn red(texture: &Texture, x: f32, y: f32) -> f32 {
        texture.at(Vec2::new(x, y)).x * 255.0
    }

    #[test]
    fn srgb_has_its_known_values() {
        for (byte, linear) in [(0, 0.0), (255, 1.0), (128, 0.215_860_5), (10, 0.003_035_27)] {
            assert!((SRGB[byte] - linear).abs() < 2e-7, "{byte}: {}", SRGB[byte]);
        }
        assert!(SRGB.windows(2).all(|w| w[0] < w[1]));
    }

    #[test]
    fn texels_are_interpolated_between_centres() {
        let t = texture(image(2, &[0, 100, 50, 250]), Wrap::Clamp);
        assert_eq!(red(&t, 0.25, 0.25), 0.0);
        assert_eq!(red(&t, 0.75, 0.25), 100.0);
        assert!((red(&t, 0.5, 0.25) - 50.0).abs() < 1e-4);
        assert!((red(&t, 0.5, 0.5) - 100.0).abs() < 1e-4);
        // Outside of the outer centres the edge goes on.
        assert_eq!(red(&t, 0.0, 0.0), 0.0);
        assert_eq!(red(&t, 5.0, 9.0), 250.0);
        let nearest = Texture { nearest: true, ..t };
        assert_eq!(red(&nearest, 0.49, 0.49), 0.0);
        assert_eq!(red(&nearest, 0.51, 0.49), 100.0);
    }

    #[test]
    fn coordinates_wrap() {
        let values = [10, 20, 30, 40];
        let repeat = texture(image(4, &values), Wrap::Repeat);
        let mirror = texture(image(4, &values), Wrap::Mirror);
        for turn in [-3.0f32, -1.0, 0.0, 2.0, 1000.0] {
            for i in 0..4 {
                let x = turn + (i as f32 + 0.5) / 4.0;
                assert!((red(&repeat, x, 0.5) - f32::from(values[i])).abs() < 1e-2);
                let seen = if turn.rem_euclid(2.0) == 1.0 { values[3 - i] } else { values[i] };
                assert!((red(&mirror, x, 0.5) - f32::from(seen)).abs() < 1e-2, "{turn} {i}");
            }
            // Across the seam.
            assert!((red(&repeat, turn, 0.5) - 25.0).abs() < 1e-2);
        }
        for hostile in [f32::NAN, f32::INFINITY, f32::MIN, 1e30] {
            assert!(red(&repeat, hostile, -hostile).is_finite());
            assert!(red(&mirror, hostile, hostile).is_finite());
        }
    }

    #[test]
    fn images_must_be_whole() {
        let texels = || Texels::Sixteen(vec![[65535, 0, 0, 65535]; 6]);
        let image = Image::new(3, 2, texels()).unwrap();
        assert_eq!(image.texel(1, 1), Vec4::new(1.0, 0.0, 0.0, 1.0));
        assert!(Image::new(2, 2, texels()).is_none());
        assert!(Image::new(0, 0, Texels::Sixteen(Vec::new())).is_none());
    }
}
