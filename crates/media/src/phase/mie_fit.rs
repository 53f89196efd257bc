//! Water droplets of cloud and fog by their diameter: Henyey-Greenstein and Draine fitted to Mie
//! scattering.

use super::draine::Draine;
use super::lobe::{Lobe, Mixture};
use crate::Error;
use libm::{cos, exp, log, pow, sin, tan};

/// Smallest diameter, micrometres: smaller droplets scatter by Rayleigh's law.
pub(crate) const MIN_DIAMETER: f64 = 0.01;
/// Largest diameter of the fit, micrometres.
pub(crate) const MAX_DIAMETER: f64 = 50.0;

/// Parameters of the fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MieFit {
    /// Mean cosine of the Henyey-Greenstein lobe: the diffraction peak.
    pub g_hg: f64,
    /// `g` of the Draine lobe: the rest.
    pub g_d: f64,
    /// `alpha` of the Draine lobe.
    pub alpha: f64,
    /// Weight of the Draine lobe.
    pub w_d: f64,
}

impl MieFit {
    /// For droplets of `diameter` micrometres in [0.01, 50].
    ///
    /// Jendersie and d'Eon, An Approximate Mie Scattering Function for Fog and Cloud Rendering,
    /// SIGGRAPH 2023 talks, equations 4 to 7 (5 to 50 micrometres) and supplement (below). Biased
    /// against Mie theory: see the book for how far, and for what it leaves out (fog bow, glory).
    ///
    /// # Errors
    /// If the diameter is outside.
    pub fn new(diameter: f64) -> Result<MieFit, Error> {
        if !(MIN_DIAMETER..=MAX_DIAMETER).contains(&diameter) {
            return Err(Error::unsupported(
                format!("the droplet diameter is {diameter} micrometres"),
                format!(
                    "give a number between {MIN_DIAMETER} and {MAX_DIAMETER}; for smaller droplets take the phase function \"rayleigh\", for larger ones a table of Mie values"
                ),
            ));
        }
        let d = diameter;
        let l = log(d);
        Ok(if d <= 0.1 {
            MieFit {
                g_hg: 13.8 * d * d,
                g_d: 1.1456 * d * sin(9.29044 * d),
                alpha: 250.0,
                w_d: 0.252977 - 312.983 * pow(d, 4.3),
            }
        } else if d < 1.5 {
            let inner = (l - 0.238604) * (l + 1.00667) / (0.507522 - 0.15677 * l);
            MieFit {
                g_hg: 0.862 - 0.143 * l * l,
                g_d: 0.379685 * cos(1.19692 * cos(inner) + 1.37932 * l + 0.0625835) + 0.344213,
                alpha: 250.0,
                w_d: 0.146209 * cos(3.38707 * l + 2.11193) + 0.316072 + 0.0778917 * l,
            }
        } else if d < 5.0 {
            MieFit {
                g_hg: 0.0604931 * log(l) + 0.940256,
                g_d: 0.500411 - 0.081287 / (-2.0 * l + tan(l) + 1.27551),
                alpha: 7.30354 * l + 6.31675,
                w_d: 0.026914 * (l - cos(5.68947 * (log(l) - 0.0292149))) + 0.376475,
            }
        } else {
            MieFit {
                g_hg: exp(-0.0990567 / (d - 1.67154)),
                g_d: exp(-2.20679 / (d + 3.91029) - 0.428934),
                alpha: exp(3.62489 - 8.29288 / (d + 5.52825)),
                w_d: exp(-0.599085 / (d - 0.641583) - 0.665888),
            }
        })
    }

    /// The two lobes of the fit, Henyey-Greenstein and Draine, by their weights.
    ///
    /// # Errors
    /// None for parameters from [`MieFit::new`].
    pub fn mixture(&self) -> Result<Mixture, Error> {
        let draine = Draine::new(self.g_d as f32, self.alpha as f32)?;
        Mixture::new([
            (1.0 - self.w_d, Mixture::of(Lobe::henyey_greenstein(self.g_hg as f32))),
            (self.w_d, Mixture::of(Lobe::Draine(draine))),
        ])
    }
}
