//! Which media a ray may meet: a hierarchy of boxes over those that have bounds, so that a scene of
//! many clouds costs what a ray meets.

use super::Ray;
use super::walks::{is_special, walk_of};
use glam::{DVec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;
use obvhs::{Boundable, BvhBuildParams};
use pileus_math::Bounds3;
use pileus_media::Medium;
use smallvec::SmallVec;
use std::fmt;
use std::sync::Arc;
use std::time::Duration;

/// Up to so many media every ray asks each: measured, a hierarchy pays from here on.
const MAX_WITHOUT_HIERARCHY: usize = 4;

/// Share of the boxes' common extent by which each is padded: what rounding to single precision can
/// move a ray or a face by.
const PADDING: f64 = 1e-6;

/// Media by number.
pub(crate) type MetMedia = SmallVec<[u32; 8]>;

/// What a medium needs of a flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Walk {
    /// A grid, walked as the kernels of one grid do.
    Grid,
    /// A grid that is walked at a drawn rate: its transmittance function is a mixture of
    /// exponentials.
    GridOnRates,
    /// Anything else.
    Other,
}

/// An index over a list of media.
#[derive(Debug)]
pub(crate) struct MediaIndex {
    /// Media that every ray asks: all of a short list, those without bounds of a long one.
    always: MetMedia,
    /// Of a short list, the media with their boxes, which tell rays that meet one of them or none,
    /// the largest in front; empty for a single medium.
    near: Vec<NearBox>,
    boxes: Option<Boxes>,
    /// By medium.
    pub(super) walks: Vec<Walk>,
    /// By medium: its place among all by density, the densest first.
    pub(super) ranks: Vec<u32>,
    /// Whether any medium may need a flight of its own, or a rate: else no flight asks.
    pub(super) special: bool,
    /// Whether any is homogeneous: else no flight asks for closed forms.
    pub(super) homogeneous: bool,
    /// Whether any has a transmittance function that is not exponential.
    pub(super) non_exponential: bool,
}

/// How many media a ray may meet.
pub(super) enum AtMostOne {
    None,
    One(usize),
    More,
}

/// A medium's number and its padded box; infinite if it fills all space.
#[derive(Debug)]
struct NearBox {
    number: u32,
    low: [f64; 3],
    high: [f64; 3],
}

/// The media with bounds, of a long list.
struct Boxes {
    bvh: Bvh2,
    /// Media by the order of the hierarchy's leaves.
    media: Vec<u32>,
    low: DVec3,
    high: DVec3,
}

impl fmt::Debug for Boxes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Boxes of {} media", self.media.len())
    }
}

struct Padded(Aabb);

impl Boundable for Padded {
    fn aabb(&self) -> Aabb {
        self.0
    }
}

impl MediaIndex {
    pub(crate) fn new(media: &[Arc<Medium>]) -> MediaIndex {
        let number = |i: usize| u32::try_from(i).unwrap_or(u32::MAX);
        let special = media.iter().any(|medium| is_special(medium));
        let homogeneous = media.iter().any(|m| m.homogeneous_box().is_some());
        let non_exponential = media.iter().any(|medium| medium.transmittance_function().is_some());
        let walks: Vec<Walk> = media.iter().map(|medium| walk_of(medium)).collect();
        let mut by_density: Vec<usize> = (0..media.len()).collect();
        by_density
            .sort_by(|&a, &b| media[b].largest_sigma_t().total_cmp(&media[a].largest_sigma_t()));
        let mut ranks = vec![0; media.len()];
        for (rank, &medium) in by_density.iter().enumerate() {
            ranks[medium] = number(rank);
        }
        let with = |always, near, boxes| MediaIndex {
            always,
            near,
            boxes,
            walks,
            ranks,
            special,
            homogeneous,
            non_exponential,
        };
        if media.len() <= MAX_WITHOUT_HIERARCHY {
            let everywhere = (DVec3::NEG_INFINITY, DVec3::INFINITY);
            let mut always = MetMedia::new();
            let mut near = Vec::new();
            for (i, medium) in media.iter().enumerate() {
                let (low, high) = match medium.bounds_world() {
                    Some(Bounds3 { low, high }) => {
                        let padding = PADDING * (high - low).max_element();
                        (low - padding, high + padding)
                    }
                    None if medium.homogeneous_box().is_some() => everywhere,
                    // An empty grid.
                    None => continue,
                };
                always.push(number(i));
                let (low, high) = (low.to_array(), high.to_array());
                near.push(NearBox { number: number(i), low, high });
            }
            if near.len() == 1 {
                near.clear();
            }
            near.sort_by(|a: &NearBox, b: &NearBox| b.volume().total_cmp(&a.volume()));
            return with(always, near, None);
        }
        let mut always = MetMedia::new();
        let mut bounded = Vec::new();
        for (i, medium) in media.iter().enumerate() {
            match medium.bounds_world() {
                Some(bounds) => bounded.push((number(i), bounds)),
                None if medium.homogeneous_box().is_some() => always.push(number(i)),
                // An empty grid.
                None => {}
            }
        }
        let all = bounded.iter().map(|(_, b)| *b).reduce(Bounds3::union);
        let Some(Bounds3 { low, high }) = all else {
            return with(always, Vec::new(), None);
        };
        let (centre, padding) = (0.5 * (low + high), PADDING * (high - low).max_element());
        let boxes: Vec<Padded> = bounded
            .iter()
            .map(|(_, Bounds3 { low, high })| {
                let corner = |p: DVec3| Vec3A::from((p - centre).as_vec3());
                Padded(Aabb::new(corner(*low - padding), corner(*high + padding)))
            })
            .collect();
        // A medium is more expensive to ask than a box.
        let parameters = BvhBuildParams { max_prims_per_leaf: 1, ..BvhBuildParams::medium_build() };
        let bvh = build_bvh2(&boxes, parameters, &mut Duration::default());
        let media = bvh
            .primitive_indices
            .iter()
            .filter_map(|&i| bounded.get(i as usize).map(|(medium, _)| *medium))
            .collect();
        with(always, Vec::new(), Some(Boxes { bvh, media, low, high }))
    }

    /// The media that `ray` may meet up to `t_max`; some of them it may miss. In no order. `found`:
    /// an empty list, where long lists put what their hierarchy finds.
    #[inline]
    pub(crate) fn along<'m>(&'m self, ray: &Ray, t_max: f64, found: &'m mut MetMedia) -> &'m [u32] {
        let Some(boxes) = &self.boxes else { return &self.always };
        found.extend_from_slice(&self.always);
        boxes.along(ray, t_max, found);
        found
    }

    /// Whether a ray may meet several media up to `t_max`, and else which.
    #[inline(always)]
    pub(super) fn at_most_one(&self, ray: &Ray, t_max: f64) -> AtMostOne {
        if self.near.is_empty() {
            return match (self.always.as_slice(), &self.boxes) {
                (&[number], None) => AtMostOne::One(number as usize),
                ([], None) => AtMostOne::None,
                _ => AtMostOne::More,
            };
        }
        let Some((largest, others)) = self.near.split_first() else { return AtMostOne::None };
        let inverse = ray.direction.as_dvec3().recip();
        let mut found = None;
        for near in others {
            if near.may_be_met(ray.origin, inverse, t_max) {
                if found.is_some() {
                    return AtMostOne::More;
                }
                found = Some(near.number);
            }
        }
        match found {
            // Whether it is met its walk finds out.
            None => AtMostOne::One(largest.number as usize),
            Some(_) if largest.may_be_met(ray.origin, inverse, t_max) => AtMostOne::More,
            Some(number) => AtMostOne::One(number as usize),
        }
    }

    /// The media that may hold a point.
    pub(crate) fn around(&self, p_world: DVec3) -> MetMedia {
        let mut met = self.always.clone();
        if let Some(Boxes { bvh, media, low, high }) = &self.boxes {
            let p = Vec3A::from((p_world - 0.5 * (*low + *high)).as_vec3());
            bvh.point_traverse(p, |bvh, node| {
                let node = &bvh.nodes[node as usize];
                let first = node.first_index as usize;
                met.extend_from_slice(&media[first..first + node.prim_count as usize]);
                true
            });
        }
        met
    }
}

impl NearBox {
    fn volume(&self) -> f64 {
        (0..3).map(|axis| self.high[axis] - self.low[axis]).product()
    }

    /// Whether a ray may meet the box up to `t_max`; `inverse`: of its direction. What is not a
    /// number comes of rays along a face, which miss.
    #[inline(always)]
    fn may_be_met(&self, origin: DVec3, inverse: DVec3, t_max: f64) -> bool {
        // One instruction each, unlike the methods of the same meaning.
        let larger = |a: f64, b: f64| if a > b { a } else { b };
        let smaller = |a: f64, b: f64| if a < b { a } else { b };
        let (mut start, mut end) = (0.0, t_max);
        for axis in 0..3 {
            let (o, inverse) = (origin[axis], inverse[axis]);
            let (a, b) = ((self.low[axis] - o) * inverse, (self.high[axis] - o) * inverse);
            start = larger(smaller(a, b), start);
            end = smaller(larger(a, b), end);
            if !(start <= end) {
                return false;
            }
        }
        true
    }
}

impl Boxes {
    fn along(&self, ray: &Ray, t_max: f64, met: &mut MetMedia) {
        let d = ray.direction.as_dvec3();
        // From where the ray enters the common box on, so that its origin is no further off than
        // the boxes are.
        let (mut t0, mut t1) = (0.0f64, t_max);
        let size = (self.high - self.low).max_element();
        for axis in 0..3 {
            let (low, high) = (self.low[axis] - PADDING * size, self.high[axis] + PADDING * size);
            let o = ray.origin[axis];
            if d[axis] == 0.0 {
                if o < low || o > high {
                    return;
                }
                continue;
            }
            let (a, b) = ((low - o) / d[axis], (high - o) / d[axis]);
            t0 = t0.max(a.min(b));
            t1 = t1.min(a.max(b));
        }
        // Also false for NaN.
        if !(t0 < t1) {
            return;
        }
        let origin = ray.origin + d * t0 - 0.5 * (self.low + self.high);
        let direction = Vec3A::from(ray.direction);
        // Along an axis a ray stays within its slab or outside, however far it goes.
        let inverse = |d: f32| 1.0 / if d.abs() < 1e-30 { 1e-30f32.copysign(d) } else { d };
        let ray = obvhs::ray::Ray {
            origin: origin.as_vec3().into(),
            direction,
            inv_direction: Vec3A::from(direction.to_array().map(inverse)),
            tmin: 0.0,
            tmax: (t1 - t0) as f32 * (1.0 + 1e-6) + (PADDING * size) as f32,
        };
        self.bvh.ray_traverse_anyhit(ray, |_, leaf| met.extend(self.media.get(leaf).copied()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use pileus_media::random::uniform;
    use pileus_media::{Medium, Phase};
    use rand_pcg::Pcg32;

    fn boxes(n: usize, spread: f64, size: f64, offset: DVec3, rng: &mut Pcg32) -> Vec<Arc<Medium>> {
        let u = |rng: &mut Pcg32| f64::from(uniform(rng));
        (0..n)
            .map(|_| {
                let low = offset + DVec3::new(u(rng), u(rng), u(rng)) * spread;
                let bounds = Bounds3::new(low, low + size * (0.1 + u(rng)));
                let phase = Phase::Isotropic;
                Arc::new(Medium::homogeneous([1.0; 3], Some(bounds), [0.5; 3], phase).unwrap())
            })
            .collect()
    }

    /// Every medium with a span on the ray, or that holds the point, is found: no hit is lost to
    /// single precision, along axes, from far away, far from the origin.
    #[test]
    fn nothing_is_missed() {
        let mut rng = Pcg32::new(3, 3);
        for (spread, size) in [(10.0, 1.0), (1e4, 1e-2), (1.0, 3.0), (1e6, 1e5)] {
            for offset in [DVec3::ZERO, DVec3::splat(1e6), DVec3::new(-3e7, 0.0, 5.0)] {
                let mut media = boxes(150, spread, size, offset, &mut rng);
                let fog = Medium::homogeneous([0.1; 3], None, [0.5; 3], Phase::Isotropic);
                media.push(Arc::new(fog.unwrap()));
                let index = MediaIndex::new(&media);
                let mut hits = 0;
                for kind in 0..4000 {
                    let mut at = || {
                        let target = &media[(uniform(&mut rng) * 150.0) as usize];
                        let Bounds3 { low, high } = target.bounds_world().unwrap();
                        let u = DVec3::new(0.0, 0.0, 0.0).map(|_| f64::from(uniform(&mut rng)));
                        low + (high - low) * u
                    };
                    let (from, to) = (at(), at());
                    let direction = match kind % 4 {
                        0 => Vec3::AXES[kind / 4 % 3],
                        1 => -Vec3::AXES[kind / 4 % 3],
                        _ => (to - from).normalize().as_vec3(),
                    };
                    let direction = if direction.is_finite() { direction } else { Vec3::X };
                    let back = if kind % 3 == 0 { 100.0 * spread } else { 0.0 };
                    let origin = from - direction.as_dvec3() * back;
                    let t_max = if kind % 5 == 0 { back + spread * 0.1 } else { f64::INFINITY };
                    let ray = Ray { origin, direction };
                    let mut found = MetMedia::new();
                    let met = index.along(&ray, t_max, &mut found);
                    for (i, medium) in media.iter().enumerate() {
                        if medium.span(origin, direction, t_max).is_some() {
                            hits += 1;
                            assert_eq!(met.iter().filter(|m| **m == i as u32).count(), 1);
                        }
                        if medium.sigma_t_at(from) > 0.0 {
                            assert!(index.around(from).contains(&(i as u32)));
                        }
                    }
                }
                assert!(hits > 8000);
            }
        }
    }

    /// Short lists: every medium with a span on a ray is among those that are asked, along faces
    /// and axes, from far away; a ray that meets one alone asks no other; and an empty grid is
    /// asked by none.
    #[test]
    fn short_lists_ask_what_is_met() {
        let mut rng = Pcg32::new(7, 7);
        let (mut hits, mut alone) = (0, 0);
        for count in 1..=MAX_WITHOUT_HIERARCHY {
            for offset in [DVec3::ZERO, DVec3::new(-3e7, 0.0, 5.0)] {
                let media = boxes(count, 3.0, 1.0, offset, &mut rng);
                let index = MediaIndex::new(&media);
                for kind in 0..3000 {
                    let medium = &media[(uniform(&mut rng) * count as f32) as usize];
                    let bounds = medium.bounds_world().unwrap();
                    let mut u = || f64::from(uniform(&mut rng));
                    // A third of the rays run along a face.
                    let on_face = if kind % 3 == 0 { 0.0 } else { u() };
                    let through = bounds.at(DVec3::new(on_face, u(), u()));
                    let direction = match kind % 4 {
                        0 => Vec3::AXES[kind / 4 % 3],
                        1 => -Vec3::AXES[kind / 4 % 3],
                        _ => (DVec3::new(u(), u(), u()) - 0.5).normalize().as_vec3(),
                    };
                    let back = if kind % 5 == 0 { 300.0 } else { 1.5 };
                    let ray = Ray { origin: through - direction.as_dvec3() * back, direction };
                    let t_max = if kind % 7 == 0 { back } else { f64::INFINITY };
                    let met: Vec<usize> = (0..count)
                        .filter(|i| media[*i].span(ray.origin, direction, t_max).is_some())
                        .collect();
                    hits += met.len();
                    let mut found = MetMedia::new();
                    let along = index.along(&ray, t_max, &mut found);
                    assert!(met.iter().all(|i| along.contains(&(*i as u32))), "{met:?} {along:?}");
                    match index.at_most_one(&ray, t_max) {
                        AtMostOne::None => assert!(met.is_empty()),
                        AtMostOne::One(number) => {
                            assert!(met.iter().all(|i| *i == number), "{met:?} {number}");
                            alone += 1;
                        }
                        AtMostOne::More => assert!(along.len() > 1),
                    }
                }
            }
        }
        assert!(hits > 15_000 && alone > 8_000, "{hits} {alone}");
    }

    /// A ray that meets few of many boxes asks few.
    #[test]
    fn what_is_far_is_not_asked() {
        let mut rng = Pcg32::new(4, 4);
        let media = boxes(1000, 100.0, 1.0, DVec3::ZERO, &mut rng);
        let index = MediaIndex::new(&media);
        let mut asked = 0;
        for _ in 0..1000 {
            let origin = DVec3::new(f64::from(uniform(&mut rng)), 0.5, 0.5) * 100.0;
            let direction = Vec3::new(1.0, uniform(&mut rng), uniform(&mut rng)).normalize();
            let ray = Ray { origin, direction };
            asked += index.along(&ray, f64::INFINITY, &mut MetMedia::new()).len();
        }
        assert!(asked < 2000, "{asked}");
    }
}
