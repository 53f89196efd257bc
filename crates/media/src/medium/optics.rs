//! What a medium does to light, wherever it has extinction.

use crate::Error;
use crate::color::ColorGrid;
use crate::phase::Phase;
use crate::transmittance_function::TransmittanceFunction;
use glam::{DVec3, Vec3};
use std::sync::Arc;

/// Single-scattering albedo, `sigma_s / sigma_t` per channel, in [0, 1].
#[derive(Debug, Clone)]
pub enum Albedo {
    /// One albedo everywhere.
    Constant([f32; 3]),
    /// Looked up where a path scatters; values outside [0, 1] are clamped.
    Grid(Arc<ColorGrid>),
}

impl Albedo {
    /// The albedo, if it is the same everywhere.
    pub fn constant(&self) -> Option<Vec3> {
        match self {
            Albedo::Constant(albedo) => Some(Vec3::from_array(*albedo)),
            Albedo::Grid(_) => None,
        }
    }

    /// # Errors
    /// If it is a constant outside [0, 1].
    pub(crate) fn check(&self) -> Result<(), Error> {
        match self {
            Albedo::Constant(albedo) if !albedo.iter().all(|a| (0.0..=1.0).contains(a)) => {
                Err(Error::invalid(
                    format!("albedo {albedo:?} is outside [0, 1]"),
                    "give numbers from 0 to 1",
                ))
            }
            _ => Ok(()),
        }
    }
}

/// The optical properties of a medium. Cheap to copy: grids and tables are shared.
#[derive(Debug, Clone)]
pub struct Optics {
    chromatic_ratio: Vec3,
    albedo: Albedo,
    phase: Phase,
    transmittance_function: Option<Arc<TransmittanceFunction>>,
}

impl Optics {
    /// The strongest channel of the extinction `sigma_t`, and optics with all channels relative to
    /// it; the transmittance function is the exponential one.
    ///
    /// # Errors
    /// If an extinction is negative or not finite, or a constant albedo is outside [0, 1].
    pub(crate) fn new(
        sigma_t: [f32; 3],
        albedo: Albedo,
        phase: Phase,
    ) -> Result<(f32, Optics), Error> {
        if !sigma_t.iter().all(|s| s.is_finite() && *s >= 0.0) {
            return Err(Error::invalid(
                format!("extinction {sigma_t:?} is negative or not finite"),
                "give numbers of at least 0",
            ));
        }
        albedo.check()?;
        let sigma_t = Vec3::from_array(sigma_t);
        let strongest = sigma_t.max_element();
        let chromatic_ratio = if strongest > 0.0 { sigma_t / strongest } else { Vec3::ONE };
        Ok((strongest, Optics { chromatic_ratio, albedo, phase, transmittance_function: None }))
    }

    pub(crate) fn with_transmittance_function(
        self,
        function: Option<Arc<TransmittanceFunction>>,
    ) -> Optics {
        Optics { transmittance_function: function, ..self }
    }

    /// Extinction per channel over that of the strongest, in [0, 1].
    #[inline(always)]
    pub fn chromatic_ratio(&self) -> Vec3 {
        self.chromatic_ratio
    }

    /// Whether all channels have the same extinction.
    #[inline(always)]
    pub fn is_grey(&self) -> bool {
        self.chromatic_ratio == Vec3::ONE
    }

    /// The albedo.
    #[inline(always)]
    pub fn albedo(&self) -> &Albedo {
        &self.albedo
    }

    /// The albedo at a point of the medium's index space, which is asked for only if it matters.
    #[inline(always)]
    pub(crate) fn albedo_at(&self, p_index: impl FnOnce() -> DVec3) -> Vec3 {
        match &self.albedo {
            Albedo::Constant(albedo) => Vec3::from_array(*albedo),
            Albedo::Grid(grid) => grid.at_index(p_index()),
        }
    }

    /// The phase function.
    #[inline(always)]
    pub fn phase(&self) -> &Phase {
        &self.phase
    }

    /// The transmittance function; `None` is the exponential one.
    #[inline(always)]
    pub fn transmittance_function(&self) -> Option<&TransmittanceFunction> {
        self.transmittance_function.as_deref()
    }
}
