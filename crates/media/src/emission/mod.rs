//! Light from volumes: what a field of emission gives off, points along rays for its line integral, and points in its volume for its light.

mod blackbody;
mod cells;
mod field;
mod observer;
mod ramp;
mod regions;
mod source;

pub use blackbody::{BlackbodyRadiance, COLDEST_KELVIN, HOTTEST_KELVIN, blackbody};
pub use cells::EmissionReport;
pub use field::{EmissionField, EmissionPoint, EmissionSample, POINTS_PER_LINE};
pub use observer::{rgb_of_xyz, xyz_of_spectrum};
pub use ramp::ColorRamp;
pub use source::EmissionSource;
