//! Light goes both ways.

use pileus_math::random::uniform;
use pileus_scene::Bsdf;
use rand_pcg::Pcg32;

use crate::materials::{NORMAL, all, direction};

/// `f(wo, wi) n_i^2 = f(wi, wo) n_o^2` for every lobe, on the same side and across, from both
/// sides.
#[test]
fn values_are_reciprocal() {
    let mut rng = Pcg32::new(11, 5);
    let mut compared = 0;
    for roughness in [0.04f32, 0.2, 0.6, 1.0] {
        for (name, p) in all(roughness) {
            for _ in 0..2000 {
                let entering = uniform(&mut rng) < 0.5;
                let at = |rng: &mut Pcg32| 0.02 + 0.98 * uniform(rng);
                let (cos_o, cos_i) = (at(&mut rng), at(&mut rng));
                let across = uniform(&mut rng) < 0.5;
                let wo = direction(cos_o, uniform(&mut rng));
                let sign = if across { -1.0 } else { 1.0 };
                let wi = direction(cos_i * sign, uniform(&mut rng));
                let there = Bsdf::new(&p, NORMAL, NORMAL, entering);
                let back = if across { Bsdf::new(&p, -NORMAL, -NORMAL, !entering) } else { there };
                let body = p.transmission > 0.0 && !p.thin_walled;
                // Diffuse light through a refracting body keeps its flux instead.
                if across && body && p.diffuse_transmission > 0.0 {
                    continue;
                }
                let n = |inside: bool| if inside && body { p.ior } else { 1.0 };
                let (n_o, n_i) = (n(!entering), n(!entering ^ across));
                let forward = there.eval(wo, wi) * (n_i * n_i) / NORMAL.dot(wi).abs();
                let backward = back.eval(wi, wo) * (n_o * n_o) / NORMAL.dot(wo).abs();
                let scale = forward.max_element().max(backward.max_element());
                let error = (forward - backward).abs().max_element();
                assert!(
                    error <= 5e-3 * scale + 1e-6,
                    "{name}, roughness {roughness}, {cos_o} {cos_i}: {forward} {backward}"
                );
                compared += usize::from(scale > 1e-4);
            }
        }
    }
    assert!(compared > 30_000, "only {compared} pairs scatter");
}
