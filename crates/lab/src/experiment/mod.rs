//! Experiments: what is measured, on what, and how it is judged.

mod laws;
mod majorants;
mod measure;
mod rays;
mod render;
mod stability;
mod stress;
mod transmittance;

pub use laws::{Levels, chart_laws};
pub use majorants::chart_majorants;
pub use measure::{Moments, Samples};
pub use rays::{LabRay, RayClass, classed_rays};
pub use render::{RenderExperiment, RenderMethod, chart_render};
pub use stability::{Stability, StabilityCell, Verdict, stability};
pub use transmittance::{Subject, TransmittanceMethod, TransmittanceSettings, chart_transmittance};
