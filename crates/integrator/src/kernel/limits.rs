//! Where paths end whatever happens: `max_bounces`, `max_events`, and whoever watches a render and
//! stops it.
//!
//! The limits share one comparison per bounce, with the bounce at which they are to be looked at
//! next: a path of fewer bounces pays for nothing else.

use crate::counters::Counters;
use crate::settings::RenderSettings;

/// Bounces of a path before its limits are looked at for the first time.
const FIRST_LOOK: u32 = 16;

/// Bounces between two looks, at most: some milliseconds.
const MAX_BOUNCES_BETWEEN_LOOKS: u64 = 256;

/// What ends paths from outside.
#[derive(Clone, Copy)]
pub(crate) struct PathLimits<'a> {
    max_bounces: u32,
    max_events: u64,
    first_look: u32,
    /// Whether the render is to stop.
    stop: &'a (dyn Fn() -> bool + Sync),
}

/// Why a path was cut.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Cut {
    MaxBounces,
    MaxEvents,
    /// The render was stopped: the path counts nowhere.
    Stopped,
}

impl<'a> PathLimits<'a> {
    /// The limits of a render that `stop` ends.
    pub(crate) fn new(
        settings: &RenderSettings,
        stop: &'a (dyn Fn() -> bool + Sync),
    ) -> PathLimits<'a> {
        let max_bounces = settings.max_bounces.unwrap_or(u32::MAX);
        let limits = PathLimits { max_bounces, max_events: u64::MAX, first_look: 0, stop };
        limits.with_max_events(settings.max_events.unwrap_or(u64::MAX))
    }

    /// These limits with at most `max_events` events.
    pub(crate) fn with_max_events(self, max_events: u64) -> PathLimits<'a> {
        let max_events = self.max_events.min(max_events);
        // At most 16: the cast loses nothing.
        let first_look = self.max_bounces.min(max_events.min(u64::from(FIRST_LOOK)) as u32);
        PathLimits { max_events, first_look, ..self }
    }

    /// These limits with at most `max_bounces` bounces.
    pub(crate) fn with_max_bounces(self, max_bounces: u32) -> PathLimits<'a> {
        let max_bounces = self.max_bounces.min(max_bounces);
        PathLimits { max_bounces, first_look: self.first_look.min(max_bounces), ..self }
    }

    /// Most bounces of a path.
    pub(crate) fn max_bounces(&self) -> u32 {
        self.max_bounces
    }

    /// The bounce at which a path has to ask for the first time.
    #[inline(always)]
    pub(crate) fn first_look(&self) -> u32 {
        self.first_look
    }

    /// Whether a path of so many bounces, of which it went straight through a pane in `crossed`,
    /// and so many events goes on, and at which bounce it has to ask again: a function of these
    /// numbers alone, but for a stop. Panes do not count to `max_bounces`.
    ///
    /// # Errors
    /// Why it ends.
    #[cold]
    #[inline(never)]
    pub(crate) fn look(&self, bounces: u32, crossed: u32, events: u64) -> Result<u32, Cut> {
        if events >= self.max_events {
            return Err(Cut::MaxEvents);
        }
        if (self.stop)() {
            return Err(Cut::Stopped);
        }
        let scatterings = bounces.saturating_sub(crossed);
        if scatterings >= self.max_bounces {
            return Err(Cut::MaxBounces);
        }
        // Until the events would be used up at the present rate.
        let per_bounce = (events / u64::from(bounces.max(1))).max(1);
        let ahead = (self.max_events - events) / per_bounce;
        // At most 256: the cast loses nothing.
        let ahead = ahead.clamp(1, MAX_BOUNCES_BETWEEN_LOOKS) as u32;
        Ok(bounces.saturating_add(ahead).min(self.max_bounces.saturating_add(crossed)))
    }
}

impl Counters {
    /// Counts a path that was cut.
    pub(crate) fn count_cut(&mut self, cut: Cut) {
        match cut {
            Cut::MaxBounces => self.cut_by_max_bounces += 1,
            Cut::MaxEvents => self.cut_by_max_events += 1,
            Cut::Stopped => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bounces at which a path with `per_bounce` events a bounce asks, and why it ends.
    fn looks(limits: &PathLimits<'_>, per_bounce: u64) -> (Vec<u32>, Cut) {
        let mut asked = vec![limits.first_look()];
        loop {
            let bounces = asked[asked.len() - 1];
            match limits.look(bounces, 0, u64::from(bounces) * per_bounce) {
                Ok(next) => {
                    assert!(next > bounces);
                    asked.push(next);
                }
                Err(cut) => return (asked, cut),
            }
        }
    }

    #[test]
    fn limits_are_met_exactly_at_an_even_rate() {
        let settings = |max_bounces, max_events| RenderSettings {
            max_bounces,
            max_events,
            ..RenderSettings::default()
        };
        let go = || false;
        for (max_bounces, max_events, per_bounce, last, cut) in [
            (Some(0), None, 1, 0, Cut::MaxBounces),
            (Some(7), None, 1, 7, Cut::MaxBounces),
            (Some(1000), Some(1 << 20), 1, 1000, Cut::MaxBounces),
            (None, Some(1), 1, 1, Cut::MaxEvents),
            (None, Some(1000), 1, 1000, Cut::MaxEvents),
            (None, Some(1000), 10, 100, Cut::MaxEvents),
            // A path whose first bounces are expensive passes its limit by 16 bounces at most.
            (None, Some(1000), 1_000_000, 16, Cut::MaxEvents),
        ] {
            let settings = settings(max_bounces, max_events);
            let (asked, why) = looks(&PathLimits::new(&settings, &go), per_bounce);
            assert_eq!((asked[asked.len() - 1], why), (last, cut), "{settings:?}");
        }
        let (asked, _) = looks(&PathLimits::new(&settings(None, Some(10_000)), &go), 1);
        assert_eq!(asked[..4], [16, 272, 528, 784]);
    }

    #[test]
    fn a_stop_ends_paths_without_limits() {
        let settings = RenderSettings { max_events: None, ..RenderSettings::default() };
        let limits = PathLimits::new(&settings, &|| true);
        assert_eq!(limits.look(limits.first_look(), 0, 1), Err(Cut::Stopped));
        let on = PathLimits::new(&settings, &|| false);
        assert_eq!(on.look(u32::MAX - 1, 0, u64::MAX / 2), Ok(u32::MAX));
    }
}
