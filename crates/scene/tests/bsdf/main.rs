//! The surface scattering model against quadrature, statistics and closed forms.

mod energy;
mod limits;
mod materials;
mod properties;
mod quadrature;
mod reciprocity;
mod sampling;
