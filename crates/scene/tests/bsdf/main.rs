//! The surface scattering model against quadrature, statistics and closed forms.
#![allow(clippy::print_stdout, reason = "figures are worth reading beside a verdict")]

mod energy;
mod limits;
mod materials;
mod properties;
mod quadrature;
mod reciprocity;
mod sampling;
