//! Light from volumes: what a field of emission emits, points along rays for its line integral,
//! and directions towards it for its light.

mod blackbody;
mod bounds;
mod cells;
mod directions;
mod field;
mod lattice;
mod observer;
mod ramp;
mod source;

pub use blackbody::{BlackbodyRadiance, HOTTEST_KELVIN, blackbody};
pub use cells::EmissionReport;
pub use directions::{EmissionDirections, EmissionView};
pub use field::{EmissionField, EmissionPoint};
pub use observer::{rgb_of_xyz, xyz_of_spectrum};
pub use ramp::ColorRamp;
pub use source::EmissionSource;
