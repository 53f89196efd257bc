//! The axes of a path kernel, each chosen once by the plan, independently of the others.

use serde::Serialize;
use std::fmt;

/// Where tentative collisions come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Events {
    /// There are no volumes.
    None,
    /// One grid.
    OneGrid,
    /// Any media, merged in order along each ray.
    MergedList,
}

/// How three channels share a path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Channels {
    /// All have the same extinction.
    Grey,
    /// Coupled until their events differ, then decoupled: split tracking.
    Split,
    /// Weighted by spectral MIS.
    Spectral,
}

/// What else a ray can meet.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum World {
    /// Volumes only.
    Volumes,
    /// Surfaces and emissive volumes.
    VolumesAndSurfaces,
}

/// Which phase functions are part of the kernel, on one grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum PhaseFunctions {
    /// Isotropic and Henyey-Greenstein, inlined.
    IsotropicOrHenyeyGreenstein,
    /// Any.
    Any,
}

/// Which path kernel runs: a choice on each axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct KernelAxes {
    /// Where tentative collisions come from.
    pub events: Events,
    /// How channels share a path.
    pub channels: Channels,
    /// What else a ray can meet.
    pub world: World,
    /// Which phase functions it has.
    pub phase: PhaseFunctions,
}

impl fmt::Display for KernelAxes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let events = match self.events {
            Events::None => {
                return f.write_str(match self.world {
                    World::Volumes => "nothing but the environment",
                    World::VolumesAndSurfaces => "no volumes, surfaces",
                });
            }
            Events::OneGrid => "one grid",
            Events::MergedList => "merged list",
        };
        let channels = match self.channels {
            Channels::Grey => "grey",
            Channels::Split => "split",
            Channels::Spectral => "spectral",
        };
        let world = match self.world {
            World::Volumes => "volumes only",
            World::VolumesAndSurfaces => "volumes and surfaces",
        };
        let phase = match self.phase {
            PhaseFunctions::IsotropicOrHenyeyGreenstein => "isotropic or Henyey-Greenstein",
            PhaseFunctions::Any => "any phase function",
        };
        write!(f, "{events}, {channels}, {world}, {phase}")
    }
}
