//! Experiments: what is measured, on what, and how it is judged.

mod debiasing;
mod majorants;
mod measure;
mod rays;
mod render;
mod stability;
mod stress;
mod transmittance;

pub use debiasing::{Levels, chart_debiasing};
pub use majorants::chart_majorants;
pub use measure::{Moments, Samples};
pub use rays::{LabRay, RayClass, classed_rays};
pub use render::{RenderExperiment, RenderMethod, chart_render};
pub use stability::{Stability, StabilityCell, Verdict, stability};
pub use transmittance::{Subject, TransmittanceMethod, TransmittanceSettings, chart_transmittance};
