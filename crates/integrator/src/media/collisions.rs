//! Tentative collisions along a ray, in order: of one medium, or of all media that the ray meets.

use super::Collision;
use super::entry::Entry;
use glam::Vec3;
use pileus_math::random::exponential;
use pileus_media::{AnyRay, RayField, Tally, Tentative, TentativeCollisions};
use rand_core::Rng;
use smallvec::SmallVec;

/// The source of a flight's tentative collisions: a Poisson process whose rate is the sum of the
/// media's majorants.
pub(crate) trait Collisions {
    /// Whether all collisions are one medium's, so that its rate may change from one to the next.
    const ONE_MEDIUM: bool;

    /// The next collision.
    fn next<R: Rng>(&mut self, rng: &mut R) -> Option<Tentative>;

    /// The next collision of a process with a share of the rate; `inverse`: one over that share, 1
    /// unless all collisions are [one medium's](Self::ONE_MEDIUM).
    fn next_of_share<R: Rng>(&mut self, inverse: f32, rng: &mut R) -> Option<Tentative>;

    /// Extinction at the last collision, 1/length, of the strongest channel that its medium is
    /// walked for.
    fn sigma_t(&self, tentative: Tentative, tally: &mut Tally) -> f32;

    /// Extinction per channel over that, of the medium of the last collision.
    fn ratio(&self) -> Vec3;

    /// Where the last collision is.
    fn place(&self, tentative: Tentative) -> Collision;

    /// Whether shadow rays walk the medium of the last collision by the same collisions, so that
    /// its null decisions belong into weights.
    fn weighted(&self) -> bool;

    /// Whether the medium of the last collision has no end, so that a walk which ignores it would
    /// not come to one.
    fn is_endless(&self) -> bool;

    /// Walks the medium of the last collision no further; whether others are left.
    fn leave_medium(&mut self) -> bool;

    /// Cells visited so far.
    fn steps(&self) -> u64;
}

/// One medium's collisions.
pub(crate) struct OneMedium<F> {
    pub(crate) walk: TentativeCollisions<F>,
    pub(crate) medium: usize,
    /// Where the field begins on the ray.
    pub(crate) t_enter: f64,
    pub(crate) ratio: Vec3,
    pub(crate) weighted: bool,
}

impl<F: RayField> Collisions for OneMedium<F> {
    const ONE_MEDIUM: bool = true;

    #[inline(always)]
    fn next<R: Rng>(&mut self, rng: &mut R) -> Option<Tentative> {
        self.walk.next(rng)
    }

    #[inline(always)]
    fn next_of_share<R: Rng>(&mut self, inverse: f32, rng: &mut R) -> Option<Tentative> {
        self.walk.next_of_share(inverse, rng)
    }

    #[inline(always)]
    fn sigma_t(&self, tentative: Tentative, tally: &mut Tally) -> f32 {
        self.walk.sigma_t(tentative, tally)
    }

    #[inline(always)]
    fn ratio(&self) -> Vec3 {
        self.ratio
    }

    #[inline(always)]
    fn place(&self, tentative: Tentative) -> Collision {
        let t = self.t_enter + self.walk.field().distance(f64::from(tentative.t));
        Collision { t, medium: self.medium }
    }

    #[inline(always)]
    fn weighted(&self) -> bool {
        self.weighted
    }

    #[inline(always)]
    fn is_endless(&self) -> bool {
        self.walk.is_endless()
    }

    #[inline(always)]
    fn leave_medium(&mut self) -> bool {
        false
    }

    #[inline(always)]
    fn steps(&self) -> u64 {
        self.walk.field().steps()
    }
}

/// A medium that a ray has come to, with its next tentative collision.
pub(super) struct Walker<'a> {
    medium: OneMedium<AnyRay<'a>>,
    next: Option<Tentative>,
    /// Where on the ray; infinite if there is none.
    t: f64,
}

impl Walker<'_> {
    fn advance<R: Rng>(&mut self, rng: &mut R) {
        self.next = self.medium.next(rng);
        self.t = self.next.map_or(f64::INFINITY, |next| self.medium.place(next).t);
    }
}

/// A medium ahead of a flight, and how it will be walked.
pub(super) struct Ahead<'a> {
    pub(super) entry: Entry<'a>,
    /// Share of the extinction to walk.
    pub(super) share: f32,
    /// Extinction per channel over that of the share.
    pub(super) ratio: Vec3,
    pub(super) weighted: bool,
}

/// The collisions of media that overlap, in order along the ray: overlapping media are independent
/// Poisson processes.
///
/// The lists are the caller's: what holds them is moved about.
pub(super) struct ManyMedia<'r, 'a> {
    /// Media that the ray has not come to, the nearest last.
    ahead: &'r mut SmallVec<[Ahead<'a>; 4]>,
    walkers: &'r mut SmallVec<[Walker<'a>; 4]>,
    /// The walker of the last collision, which has to advance before the next.
    last: Option<usize>,
    /// Stratified majorant depth of the very first collision.
    first: Option<f32>,
}

impl<'r, 'a> ManyMedia<'r, 'a> {
    /// `walkers`: an empty list.
    pub(super) fn new(
        ahead: &'r mut SmallVec<[Ahead<'a>; 4]>,
        walkers: &'r mut SmallVec<[Walker<'a>; 4]>,
        first: Option<f32>,
    ) -> ManyMedia<'r, 'a> {
        ManyMedia { ahead, walkers, last: None, first }
    }

    fn nearest(&self) -> Option<usize> {
        (0..self.walkers.len()).min_by(|&a, &b| self.walkers[a].t.total_cmp(&self.walkers[b].t))
    }

    #[inline(always)]
    fn last(&self) -> &OneMedium<AnyRay<'a>> {
        // A collision has been handed out before anything is asked of it.
        &self.walkers[self.last.unwrap_or(0)].medium
    }
}

impl Collisions for ManyMedia<'_, '_> {
    const ONE_MEDIUM: bool = false;

    fn next<R: Rng>(&mut self, rng: &mut R) -> Option<Tentative> {
        if let Some(last) = self.last.take() {
            self.walkers[last].advance(rng);
        }
        loop {
            let nearest = self.nearest();
            let t = nearest.map_or(f64::INFINITY, |nearest| self.walkers[nearest].t);
            // A medium is walked once the flight has come to where it begins.
            if self.ahead.last().is_some_and(|ahead| ahead.entry.t() <= t)
                && let Some(Ahead { entry, share, ratio, weighted }) = self.ahead.pop()
            {
                let depth = self.first.take().unwrap_or_else(|| exponential(rng));
                let field = entry.field(share);
                let walk = TentativeCollisions::with_first(field, depth);
                let (t_enter, medium) = (entry.t(), entry.medium());
                let medium = OneMedium { walk, medium, t_enter, ratio, weighted };
                let mut walker = Walker { medium, next: None, t: f64::INFINITY };
                walker.advance(rng);
                self.walkers.push(walker);
                continue;
            }
            let next = self.walkers.get(nearest?)?.next?;
            self.last = nearest;
            return Some(next);
        }
    }

    fn next_of_share<R: Rng>(&mut self, _: f32, rng: &mut R) -> Option<Tentative> {
        self.next(rng)
    }

    fn sigma_t(&self, tentative: Tentative, tally: &mut Tally) -> f32 {
        self.last().sigma_t(tentative, tally)
    }

    fn ratio(&self) -> Vec3 {
        self.last().ratio
    }

    fn place(&self, tentative: Tentative) -> Collision {
        self.last().place(tentative)
    }

    fn weighted(&self) -> bool {
        self.last().weighted
    }

    fn is_endless(&self) -> bool {
        self.last().is_endless()
    }

    fn leave_medium(&mut self) -> bool {
        if let Some(last) = self.last.take() {
            // What it has walked still counts among the steps.
            (self.walkers[last].next, self.walkers[last].t) = (None, f64::INFINITY);
        }
        true
    }

    fn steps(&self) -> u64 {
        self.walkers.iter().map(|walker| walker.medium.steps()).sum()
    }
}
