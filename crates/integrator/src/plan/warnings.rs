//! What can be said of a scene before a path is traced: paths that would not end, pictures that
//! will be black, volumes that nobody will see.
//!
//! Everything here is geometry and arithmetic on what was loaded; its work has a bound.

use crate::error::{Error, Parameter, Remedy};
use crate::settings::{DEFAULT_MAX_EVENTS, RenderSettings};
use glam::{DVec3, Vec3};
use pileus_math::Bounds3;
use pileus_media::Medium;
use pileus_media::kernel::{GridShape, Shape};
use pileus_scene::{Scene, Surfaces, Volume};
use rand_pcg::Pcg32;

/// How lines about `max_events` begin.
pub(crate) const MAX_EVENTS: &str = "max_events";

const CHANNELS: [&str; 3] = ["red", "green", "blue"];

/// Pairs of a volume and an instance beyond which nobody looks for volumes inside meshes.
const MAX_PAIRS: usize = 1 << 20;

/// Of these, those whose boxes hold each other and which rays are traced for.
const MAX_CANDIDATES: usize = 32;

/// Surfaces in the way of a ray after which it is given up.
const MAX_SURFACES_ON_A_RAY: usize = 64;

/// The homogeneous media without bounds, with the names of their volumes and their extinction per
/// channel, 1/length.
fn fogs(scene: &Scene) -> impl Iterator<Item = (&str, &Medium, Vec3)> {
    scene.volumes.iter().filter_map(|volume| {
        let medium = &*volume.medium;
        let fog = medium.homogeneous_box().filter(|shape| shape.bounds_world().is_none())?;
        let sigma_t = medium.chromatic_ratio() * fog.sigma_t();
        Some((volume.name.as_str(), medium, sigma_t))
    })
}

/// Names of those of three channels for which `of` holds.
fn channels(of: impl Fn(usize) -> bool) -> Vec<&'static str> {
    (0..3).filter(|c| of(*c)).map(|c| CHANNELS[c]).collect()
}

/// Names in backticks, the first of many.
fn names<'a>(names: impl Iterator<Item = &'a str>) -> String {
    const SHOWN: usize = 4;
    let all: Vec<String> = names.map(|name| format!("`{name}`")).collect();
    let shown = all.iter().take(SHOWN).cloned().collect::<Vec<_>>().join(", ");
    if all.len() > SHOWN { format!("{shown} and {} more", all.len() - SHOWN) } else { shown }
}

/// Whether light of channel `c` meets extinction everywhere in space, and none of it absorbs.
fn scatters_forever(scene: &Scene, c: usize) -> bool {
    let mut met = fogs(scene).filter(|(.., sigma_t)| sigma_t[c] > 0.0).peekable();
    met.peek().is_some() && met.all(|(_, medium, _)| absorbs_nothing(medium, c))
}

fn absorbs_nothing(medium: &Medium, channel: usize) -> bool {
    medium.optics().albedo().constant().is_some_and(|albedo| albedo[channel] >= 1.0)
}

/// Refuses scenes in which a share of the paths never ends: media without bounds scatter, none of
/// them absorbs in some channel, and there is no surface that could. Whatever else is there is
/// finite, and a random walk in space leaves it for good with a probability above zero.
///
/// # Errors
/// If the scene is of that kind.
pub(crate) fn refuse_endless(scene: &Scene) -> Result<(), Error> {
    let endless = channels(|c| scatters_forever(scene, c));
    if endless.is_empty() || scene.surfaces.is_some() {
        return Ok(());
    }
    let of = |(name, medium, sigma_t): (_, &Medium, Vec3)| {
        (0..3).any(|c| sigma_t[c] > 0.0 && absorbs_nothing(medium, c)).then_some(name)
    };
    Err(Error::Scene {
        what: format!(
            "volume {} fills all space, scatters and absorbs nothing ({}): paths would never end",
            names(fogs(scene).filter_map(of)),
            if endless.len() == 3 {
                "albedo 1".to_owned()
            } else {
                format!("albedo 1 in {}", endless.join(" and "))
            },
        ),
        remedies: vec![
            Remedy::Scene("give it bounds, or an albedo below 1"),
            Remedy::Limit(Parameter::MaxBounces),
        ],
    })
}

/// The largest albedo of any channel that a medium extinguishes.
fn largest_albedo(medium: &Medium) -> f32 {
    let albedo = medium.optics().albedo().constant().unwrap_or(Vec3::ONE);
    let relative = medium.chromatic_ratio();
    (0..3).filter(|c| relative[*c] > 0.0).map(|c| albedo[c]).fold(0.0, f32::max)
}

/// Largest extinction times the diagonal of the medium's box: a bound of its optical depth;
/// infinite without bounds.
fn largest_depth(medium: &Medium) -> f64 {
    let sigma_t = medium.largest_sigma_t();
    let length = match (medium.shape(), medium.bounds_world()) {
        (_, Some(bounds)) => bounds.size().length(),
        (Shape::Grid(_), None) => 0.0,
        (Shape::Box(_), None) => f64::INFINITY,
    };
    if sigma_t > 0.0 { sigma_t * length } else { 0.0 }
}

/// What the plan lists as biased where the limit of events may cut paths: those that a user has
/// lowered, and media in which paths may be that long.
pub(crate) fn may_cut(scene: &Scene, settings: &RenderSettings) -> Option<String> {
    let limit = settings.max_events?;
    if limit < DEFAULT_MAX_EVENTS {
        return Some(format!("{MAX_EVENTS} {limit}: longer paths are cut"));
    }
    // Scatterings are fewer than events. That many absorb all but exp(-30) of a path, or let it
    // diffuse out of a depth whose square is a tenth of their number but for as much: the slowest
    // mode of a slab decays as exp(-pi^2 n / (3 depth^2)).
    let scatterings = limit as f64;
    let long = |volume: &&Volume| {
        let kept = f64::from(1.0 - largest_albedo(&volume.medium));
        let depth = largest_depth(&volume.medium);
        kept * scatterings < 30.0 && depth * depth > scatterings / 10.0
    };
    let long = || scene.volumes.iter().filter(long);
    long().next()?;
    Some(format!(
        "{MAX_EVENTS} {limit}: may cut paths in volume {}: next to no absorption, and great depth",
        names(long().map(|volume| volume.name.as_str()))
    ))
}

/// The largest optical depth of a voxel of any grid; `None` without grids.
pub(crate) fn depth_of_a_voxel<'a>(media: impl Iterator<Item = &'a Medium>) -> Option<f64> {
    let depths = media.filter_map(|medium| {
        let grid = medium.grid()?;
        let axes = grid.index_to_world().matrix3;
        let edges = [axes.x_axis, axes.y_axis, axes.z_axis].map(DVec3::length);
        let edge = edges.into_iter().fold(0.0, f64::max);
        Some(edge * f64::from(grid.sigma_t_scale()) * f64::from(grid.voxels().range().1))
    });
    depths.reduce(f64::max)
}

/// All warnings that need no path.
pub(crate) fn all(scene: &Scene, settings: &RenderSettings) -> Vec<String> {
    let mut lines = Vec::new();
    lines.extend(loose_weights(settings));
    lines.extend(short_flights(scene));
    lines.extend(darkness(scene));
    lines.extend(out_of_sight(scene));
    lines.extend(enclosed(scene));
    lines
}

/// Majorants that are made not to hold: what follows is unbiased, and may be nothing but noise.
fn loose_weights(settings: &RenderSettings) -> Option<String> {
    let scale = settings.majorant_scale;
    (scale < 1.0).then(|| {
        format!(
            "majorant_scale {scale}: bounds do not hold, and weights of flights and shadow rays have either sign; they grow exponentially with what exceeds the bounds, so that the picture may be noise alone"
        )
    })
}

/// Share of a mean free path that positions may be rounded by.
const MAX_ROUNDING: f64 = 2.5e-3;

/// Media so dense that paths cannot move in them: a flight is as short as the distance between the
/// numbers that positions are stored in. Light is wrong there, by some percent at first.
fn short_flights(scene: &Scene) -> Option<String> {
    let origins = scene.camera.origins(0.0);
    let camera = origins.low.abs().max(origins.high.abs()).max_element();
    let dense = scene.volumes.iter().filter(|volume| {
        let sigma_t = volume.medium.largest_sigma_t();
        let corners = volume.medium.bounds_world();
        let reach = corners.map_or(0.0, |b: Bounds3| b.low.abs().max(b.high.abs()).max_element());
        sigma_t * reach.max(camera) * f64::EPSILON > MAX_ROUNDING
    });
    let found = names(dense.map(|volume| volume.name.as_str()));
    (!found.is_empty()).then(|| {
        format!(
            "volume {found}: mean free paths are as short as positions in double precision are rounded: its light is wrong (too bright, by some percent and more); a lower density looks the same"
        )
    })
}

/// What is known of volumes that none of `paths` paths has met, as camera path or shadow ray.
pub(crate) fn met_by_none(scene: &Scene, paths: u32) -> Option<String> {
    let extinguishes = |volume: &&Volume| {
        let seen = |grid: &GridShape| grid.sigma_t_scale() > 0.0 && grid.bounds_world().is_some();
        volume.medium.grid().is_some_and(seen)
    };
    let grids = || scene.volumes.iter().filter(extinguishes);
    grids().next()?;
    Some(format!(
        "none of {paths} trial paths met volume {}: it is outside the picture, small in it, or hidden behind or inside something opaque",
        names(grids().map(|volume| volume.name.as_str()))
    ))
}

/// Pictures without light: nothing shines, or nothing that shines gets through.
fn darkness(scene: &Scene) -> Option<String> {
    let bright = |rgb: Vec3| rgb.max_element() > 0.0;
    let shines = |at_infinity: bool| {
        let mut lights = scene.lights.iter().filter(|l| l.position().is_none() == at_infinity);
        lights.any(|light| bright(light.strength()))
    };
    let distant = !scene.environment.is_black() || shines(true);
    let near = shines(false)
        || scene.surfaces.as_ref().is_some_and(|surfaces| surfaces.emits())
        || scene.emissive_volumes().any(|field| field.bounds_world().is_some());
    if !distant && !near {
        return Some(
            "nothing shines: every light is black, and so is the picture; give the scene a light"
                .into(),
        );
    }
    let blocked = |c: usize| fogs(scene).any(|(.., sigma_t)| sigma_t[c] > 0.0);
    let colours = channels(blocked);
    if !distant || colours.is_empty() {
        return None;
    }
    let fogs = names(fogs(scene).filter(|(.., s)| bright(*s)).map(|(name, ..)| name));
    let light = if colours.len() == 3 {
        "light".to_owned()
    } else {
        format!("{} light", colours.join(" and "))
    };
    let so = match (near, colours.len()) {
        (true, _) => "what else shines lights the scene alone",
        (false, 3) => "the picture is black",
        (false, _) => "the picture has none",
    };
    Some(format!(
        "volume {fogs} fills all space: no {light} of a sun, a sky or an environment gets through, and {so}; give it bounds, or lights that have a place"
    ))
}

/// The box of what a volume extinguishes or emits.
fn bounds_of(volume: &Volume) -> Option<Bounds3> {
    let emission = volume.emission.as_ref().and_then(|field| field.bounds_world());
    let both = volume.medium.bounds_world().into_iter().chain(emission);
    both.reduce(Bounds3::union)
}

/// Scenes of which nothing lies within the picture's frame.
fn out_of_sight(scene: &Scene) -> Option<String> {
    if fogs(scene).next().is_some() {
        return None;
    }
    let volumes = scene.volumes.iter().filter_map(bounds_of);
    let surfaces = scene.surfaces.iter().flat_map(|surfaces| surfaces.instance_bounds());
    let mut bounds = volumes.chain(surfaces).peekable();
    bounds.peek()?;
    bounds.all(|bounds| !scene.camera.may_see(bounds)).then(|| {
        "no volume and no surface lies in the picture: all are behind the camera or beside what it sees; turn it towards them"
            .into()
    })
}

/// Volumes wholly inside closed, opaque meshes that the camera is not in.
fn enclosed(scene: &Scene) -> Vec<String> {
    let mut lines = Vec::new();
    let Some(surfaces) = scene.surfaces.as_deref() else { return lines };
    let boxes: Vec<_> = surfaces.instance_bounds().collect();
    if boxes.len().saturating_mul(scene.volumes.len()) > MAX_PAIRS {
        return lines;
    }
    let mut candidates = 0;
    for volume in &scene.volumes {
        let Some(own) = bounds_of(volume) else { continue };
        let points = points_of(volume, own);
        // Of a volume that is turned, the box is larger than the body.
        let slack = own.size() * 0.25;
        let around = boxes.iter().zip(0u32..).filter(|(bounds, instance)| {
            bounds.low.cmple(own.low + slack).all()
                && bounds.high.cmpge(own.high - slack).all()
                && surfaces.mesh_is_closed(*instance)
        });
        for (bounds, instance) in around {
            candidates += 1;
            if candidates > MAX_CANDIDATES {
                return lines;
            }
            let hidden = |p: &DVec3| hidden_by(surfaces, (instance, *bounds), *p);
            let mut material = None;
            let all = !points.is_empty()
                && points.iter().all(|p| {
                    let found = hidden(p);
                    material = material.or(found);
                    found.is_some()
                });
            let Some(material) = material.filter(|_| all) else { continue };
            if camera_may_be_inside(scene, *bounds, &hidden) {
                continue;
            }
            lines.push(format!(
                "volume `{}` lies wholly inside mesh `{}`, which is closed and opaque (material `{}`): nobody will see it. Blender exports a material with nothing but a \
                 volume shader, as the domain of a smoke simulation has, as opaque white: leave that mesh out of the export, or give it alpha 0",
                volume.name,
                surfaces.instance_name(instance),
                surfaces.material_name(material),
            ));
            break;
        }
    }
    lines
}

/// Whether some ray of the camera may start inside a mesh in this box; `hidden` tells of points
/// whether they are inside.
fn camera_may_be_inside(
    scene: &Scene,
    bounds: Bounds3,
    hidden: &dyn Fn(&DVec3) -> Option<u32>,
) -> bool {
    if scene.camera.has_one_origin() {
        return hidden(&scene.camera.position()).is_some();
    }
    // A lens or an orthographic film may be in it with any part.
    bounds.overlaps(scene.camera.origins(0.0))
}

/// Points inside a volume where it extinguishes or emits light, 64 at most.
fn points_of(volume: &Volume, bounds: Bounds3) -> Vec<DVec3> {
    const SIDE: u32 = 4;
    let at = |i: u32| (f64::from(i) + 0.5) / f64::from(SIDE);
    let lattice = (0..SIDE.pow(3)).map(|i| {
        let u = DVec3::new(at(i % SIDE), at(i / SIDE % SIDE), at(i / (SIDE * SIDE)));
        bounds.at(u)
    });
    let filled = |p: &DVec3| {
        volume.medium.sigma_t_at(*p) > 0.0
            || volume.emission.as_ref().is_some_and(|field| field.emission(*p).max_element() > 0.0)
    };
    lattice.filter(filled).collect()
}

/// Whether an opaque instance hides a point from outside in all directions that are tried; the
/// number of a material that does.
fn hidden_by(surfaces: &Surfaces, (instance, bounds): (u32, Bounds3), p: DVec3) -> Option<u32> {
    // Corners of a tetrahedron and of its mirror image, turned so that none lies along an axis.
    let directions = [
        Vec3::new(0.36, 0.48, 0.8),
        Vec3::new(-0.8, 0.36, -0.48),
        Vec3::new(0.48, -0.8, 0.36),
        Vec3::new(-0.36, -0.48, -0.8),
        Vec3::new(0.8, -0.36, 0.48),
        Vec3::new(-0.48, 0.8, -0.36),
    ];
    let reach = bounds.size().length() + (p - bounds.centre()).length();
    let mut rng = Pcg32::new(0, 0);
    let mut material = None;
    for direction in directions {
        let mut origin = p + direction.as_dvec3() * reach;
        let mut hides = None;
        for _ in 0..MAX_SURFACES_ON_A_RAY {
            let left = (p - origin).length();
            let Some(hit) = surfaces.intersect(origin, -direction, left, &mut rng) else { break };
            let interaction = surfaces.interaction(&hit, -direction);
            if hit.instance == instance {
                hides =
                    (interaction.parameters.transmission == 0.0).then_some(interaction.material);
                break;
            }
            origin = interaction.spawn(-direction);
        }
        material = Some(hides?);
    }
    material
}
