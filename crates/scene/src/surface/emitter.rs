//! Triangles that emit light.

use glam::{DVec3, UVec2, Vec2, Vec3};

use super::material::Material;
use super::mesh::Mesh;
use super::texture::{Image, Texture, Wrap};

/// A triangle of an instance that emits light, in world space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EmissiveTriangle {
    /// First vertex of the triangle, in world space.
    pub p0: DVec3,
    /// From the first to the second vertex. The point with barycentrics `[b1, b2]` is
    /// `p0 + b1 e1 + b2 e2`.
    pub e1: DVec3,
    /// From the first to the third vertex.
    pub e2: DVec3,
    /// Unit normal on the front side. Where an instance is mirrored, it is opposite to `e1 x e2`.
    pub normal: Vec3,
    /// Area of the triangle, in scene units squared.
    pub area: f64,
    /// Emitted radiance averaged over it, holes of its alpha counted as dark: by at most some 250
    /// samples of its textures, raised so that no channel is 0 that may emit anywhere.
    pub radiance: Vec3,
    /// Whether its back emits as well.
    pub two_sided: bool,
    /// The instance it belongs to.
    pub instance: u32,
    /// Number of the triangle in the instance's mesh.
    pub triangle: u32,
    /// How far points of it may be off their plane by rounding.
    pub(crate) offset: f64,
}

impl EmissiveTriangle {
    /// The point with these barycentrics, moved off the surface by no more than rounding asks
    /// for, to the side of `seen_from`: the end of a shadow ray.
    pub fn point(&self, [b1, b2]: [f32; 2], seen_from: DVec3) -> DVec3 {
        let p = self.p0 + self.e1 * f64::from(b1) + self.e2 * f64::from(b2);
        let normal = self.normal.as_dvec3();
        let side = (seen_from - p).dot(normal);
        p + normal * self.offset.copysign(side)
    }

    /// Mean emitted power over pi of the sides that emit: area times radiance, twice if both do.
    pub fn weight(&self) -> Vec3 {
        let sides = if self.two_sided { 2.0 } else { 1.0 };
        self.radiance * (self.area as f32 * sides)
    }
}

/// The largest value of each channel in squares of 2^level texels.
#[derive(Debug)]
pub(crate) struct Peaks {
    levels: Vec<Level>,
}

#[derive(Debug)]
struct Level {
    width: u32,
    height: u32,
    values: Vec<Vec3>,
}

impl Level {
    fn at(&self, x: u32, y: u32) -> Vec3 {
        let at = y.min(self.height - 1) as usize * self.width as usize;
        self.values.get(at + x.min(self.width - 1) as usize).copied().unwrap_or(Vec3::ZERO)
    }
}

impl Peaks {
    pub(crate) fn new(image: &Image) -> Self {
        let [width, height] = image.size();
        let values = (0..height)
            .flat_map(|y| (0..width).map(move |x| (x, y)))
            .map(|(x, y)| image.texel(x, y).truncate())
            .collect();
        let mut level = Level { width, height, values };
        let mut levels = Vec::new();
        while level.width > 1 || level.height > 1 {
            let (width, height) = (level.width.div_ceil(2), level.height.div_ceil(2));
            let values = (0..height)
                .flat_map(|y| (0..width).map(move |x| (2 * x, 2 * y)))
                .map(|(x, y)| {
                    let top = level.at(x, y).max(level.at(x + 1, y));
                    top.max(level.at(x, y + 1).max(level.at(x + 1, y + 1)))
                })
                .collect();
            levels.push(std::mem::replace(&mut level, Level { width, height, values }));
        }
        levels.push(level);
        Self { levels }
    }

    /// An upper bound of what a texture of this image is between these coordinates.
    pub(crate) fn bound(&self, texture: &Texture, low: Vec2, high: Vec2) -> Vec3 {
        let [width, height] = texture.image.size();
        let size = UVec2::new(width, height);
        let range = |axis: usize| -> Option<[u32; 2]> {
            let n = f64::from(size[axis]);
            // A texel more than interpolation reaches.
            let first = (f64::from(low[axis]) * n - 1.5).floor();
            let last = (f64::from(high[axis]) * n + 1.5).floor();
            let wrapped = match texture.wrap[axis] {
                Wrap::Clamp => (first.clamp(0.0, n - 1.0), last.clamp(0.0, n - 1.0)),
                Wrap::Repeat => {
                    let turn = (first / n).floor() * n;
                    (first - turn, last - turn)
                }
                Wrap::Mirror => (first, last),
            };
            let inside = wrapped.0 >= 0.0 && wrapped.1 <= n - 1.0;
            inside.then_some([wrapped.0 as u32, wrapped.1 as u32])
        };
        let (Some([x0, x1]), Some([y0, y1])) = (range(0), range(1)) else {
            return self.levels.last().map_or(Vec3::ZERO, |top| top.at(0, 0));
        };
        // The level on which at most three squares along each axis cover the range.
        let longest = (x1 - x0).max(y1 - y0);
        let fine = (32 - longest.leading_zeros()).saturating_sub(1) as usize;
        let index = fine.min(self.levels.len() - 1);
        let Some(level) = self.levels.get(index) else { return Vec3::ZERO };
        let mut bound = Vec3::ZERO;
        for y in y0 >> index..=y1 >> index {
            for x in x0 >> index..=x1 >> index {
                bound = bound.max(level.at(x, y));
            }
        }
        bound
    }
}

/// Mean radiance of a triangle of a mesh as in [`EmissiveTriangle::radiance`]; zero only if the
/// triangle emits nowhere.
pub(crate) fn mean_radiance(
    mesh: &Mesh,
    triangle: usize,
    material: &Material,
    peaks: Option<&Peaks>,
) -> Vec3 {
    let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]].map(|b| mesh.point(triangle, b));
    let texture =
        if material.unlit { &material.base_color_texture } else { &material.emission_texture };
    let (bound, steps) = match (texture, peaks) {
        (Some(texture), Some(peaks)) => {
            let [a, b, c] = corners.map(|point| texture.place(&point.uv));
            let (low, high) = (a.min(b).min(c), a.max(b).max(c));
            let [width, height] = texture.image.size();
            let texels = (high - low) * Vec2::new(width as f32, height as f32);
            // Not a number counts as many.
            let steps = if texels.max_element() <= 16.0 {
                (texels.max_element() as u32).clamp(4, 16)
            } else {
                16
            };
            (peaks.bound(texture, low, high), steps)
        }
        _ => (Vec3::ONE, 4),
    };
    let factor = if material.unlit {
        // Colours of vertices are interpolated: none is larger than the largest.
        let [a, b, c] = corners.map(|point| point.color.truncate());
        material.base_color.truncate() * a.max(b).max(c)
    } else {
        material.emission
    };
    let bound = (bound * factor).max(Vec3::ZERO);
    if bound == Vec3::ZERO {
        return Vec3::ZERO;
    }
    let mut sum = Vec3::ZERO;
    for i in 0..steps {
        for j in 0..steps {
            // Strata of the unit square, folded onto the triangle, which keeps areas.
            let [mut u, mut v] = [i, j].map(|k| (k as f32 + 0.5) / steps as f32);
            if u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            let point = mesh.point(triangle, [u, v]);
            sum += material.emission(&point) * material.coverage(&point);
        }
    }
    (sum / (steps * steps) as f32).max(bound / 64.0)
}

#[cfg(test)]
mod tests {
    use super::super::texture::tests::{image, texture};
    use super::*;

    /// The bound holds for every lookup in random rectangles, and is tight on small ones.
    #[test]
    fn peaks_bound_what_a_lookup_returns() {
        let values: Vec<u8> =
            (0..37 * 11).map(|i: u32| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
        let image = image(37, &values);
        let peaks = Peaks::new(&image);
        for wrap in [Wrap::Clamp, Wrap::Repeat, Wrap::Mirror] {
            let t = texture(image.clone(), wrap);
            for i in 0..400u32 {
                let random = |k: u32| {
                    let h = (i * 7 + k).wrapping_mul(0x9e37_79b9) >> 8;
                    h as f32 / (1u32 << 24) as f32
                };
                let low = Vec2::new(random(1) * 4.0 - 2.0, random(2) * 4.0 - 2.0);
                let size = Vec2::new(random(3), random(4)) * if i % 2 == 0 { 1.0 } else { 0.05 };
                let bound = peaks.bound(&t, low, low + size);
                for x in 0..8 {
                    for y in 0..8 {
                        let at = low + size * Vec2::new(x as f32, y as f32) / 7.0;
                        assert!(t.at(at).x <= bound.x + 1e-6, "{wrap:?} {low} {size}");
                    }
                }
            }
        }
        let mut dark = vec![0; 64 * 64];
        dark[0] = 255;
        let dark = super::super::texture::tests::image(64, &dark);
        let peaks = Peaks::new(&dark);
        let t = texture(dark, Wrap::Repeat);
        assert_eq!(peaks.bound(&t, Vec2::splat(0.4), Vec2::splat(0.5)).x, 0.0);
        assert_eq!(peaks.bound(&t, Vec2::splat(-0.01), Vec2::splat(0.01)).x, 1.0);
    }
}
