//! What the plan says of lights: those without extent, and the panes they shine through.

use crate::kernel::luminance;
use pileus_scene::{Scene, Surfaces};

/// Lights without extent, in words; `None` if there is none that shines.
fn lights_without_extent(scene: &Scene) -> Option<String> {
    let mut counts: Vec<([&str; 2], usize)> = Vec::new();
    for light in &scene.lights {
        if light.has_extent() || !(luminance(light.strength()) > 0.0) {
            continue;
        }
        match counts.iter_mut().find(|(names, _)| *names == light.names()) {
            Some((_, count)) => *count += 1,
            None => counts.push((light.names(), 1)),
        }
    }
    let found: Vec<String> = counts
        .into_iter()
        .map(|([one, many], count)| format!("{count} {}", if count == 1 { one } else { many }))
        .collect();
    (!found.is_empty()).then(|| found.join(", "))
}

/// Says which materials lights without extent shine through, and which not.
pub(super) fn describe_panes(
    scene: &Scene,
    surfaces: &Surfaces,
    reasons: &mut Vec<String>,
    not_modelled: &mut Vec<String>,
) {
    let Some(lights) = lights_without_extent(scene) else { return };
    let listed = |names: &[String]| {
        let some = names.iter().take(MAX_NAMED).map(String::as_str).collect::<Vec<_>>().join(", ");
        match names.len().saturating_sub(MAX_NAMED) {
            0 => some,
            more => format!("{some} and {more} more"),
        }
    };
    let named = |name: &str| {
        if name.is_empty() { "a material without name".to_owned() } else { format!("`{name}`") }
    };
    let panes: Vec<String> = surfaces.panes().iter().map(|name| named(name)).collect();
    if !panes.is_empty() {
        reasons.push(format!(
            "shadow rays to {lights} go straight through smooth thin walls and bodies of index 1, tinted by them, and these count as no bounces: {}",
            listed(&panes)
        ));
    }
    let (bent, rough): (Vec<_>, Vec<_>) =
        surfaces.obstacles().into_iter().partition(|obstacle| obstacle.bends);
    if !bent.is_empty() {
        let bent: Vec<String> =
            bent.iter().map(|o| format!("{} (index {})", named(&o.name), o.ior)).collect();
        not_modelled.push(format!(
            "light of {lights} through glass that bends it: it does not pass {}, since no path can find a light without extent there; give the sun a \
             size, make the light an emissive mesh, the glass a thin wall, or its index 1",
            listed(&bent)
        ));
    }
    if !rough.is_empty() {
        let rough: Vec<String> = rough
            .iter()
            .map(|o| format!("{} (roughness {})", named(&o.name), o.roughness))
            .collect();
        reasons.push(format!(
            "light of {lights} does not go straight through {}: paths find it from the surface, which scatters it",
            listed(&rough)
        ));
    }
}

/// Most materials that a sentence of the plan names.
const MAX_NAMED: usize = 8;
