//! Rays against surfaces: the whole way through both levels, and the two trees of `obvhs` on the
//! same triangles with the same test. Figures stand in decision 6.

use pileus_math::Bounds3;
use std::hint::black_box;
use std::path::Path;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::{DVec3, Vec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::builder::build_bvh2;
use obvhs::cwbvh::builder::build_cwbvh;
use obvhs::ray::{Ray, RayHit};
use pileus_scene::surface::triangle::ShearedRay;
use pileus_scene::{GlassRule, Surfaces, gltf};
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

const RAYS: usize = 4096;

fn number(rng: &mut Pcg64Mcg) -> f64 {
    (rng.next_u64() >> 11) as f64 / (1u64 << 53) as f64
}

fn direction(rng: &mut Pcg64Mcg) -> DVec3 {
    let z = 2.0 * number(rng) - 1.0;
    let (sin, cos) = (number(rng) * std::f64::consts::TAU).sin_cos();
    DVec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z)
}

/// A bumpy sphere of 101,120 triangles.
fn sphere() -> Vec<[Vec3; 3]> {
    let (rows, columns) = (159, 320);
    let vertex = |i: usize, j: usize| {
        let theta = i as f64 / rows as f64 * std::f64::consts::PI;
        let phi = (j % columns) as f64 / columns as f64 * std::f64::consts::TAU;
        let r = 1.0 + 0.1 * (9.0 * theta).sin() * (7.0 * phi).cos();
        (DVec3::new(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin()) * r).as_vec3()
    };
    let mut triangles = Vec::new();
    for i in 0..rows {
        for j in 0..columns {
            let [a, b] = [vertex(i, j), vertex(i, j + 1)];
            let [c, d] = [vertex(i + 1, j), vertex(i + 1, j + 1)];
            if i > 0 {
                triangles.push([a, b, c]);
            }
            if i + 1 < rows {
                triangles.push([b, d, c]);
            }
        }
    }
    triangles
}

/// Triangles as the only mesh of a .glb file.
fn glb(triangles: &[[Vec3; 3]]) -> Vec<u8> {
    let bin: Vec<u8> =
        triangles.iter().flatten().flat_map(|p| p.to_array()).flat_map(f32::to_le_bytes).collect();
    let mut json = format!(
        r#"{{"asset":{{"version":"2.0"}},"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}}}]}}],"buffers":[{{"byteLength":{0}}}],
        "bufferViews":[{{"buffer":0,"byteLength":{0}}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"type":"VEC3","count":{1}}}]}}"#,
        bin.len(),
        triangles.len() * 3
    )
    .into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut bytes = b"glTF".to_vec();
    for word in [2, 28 + json.len() as u32 + bin.len() as u32, json.len() as u32] {
        bytes.extend(word.to_le_bytes());
    }
    bytes.extend(b"JSON");
    bytes.extend(&json);
    bytes.extend((bin.len() as u32).to_le_bytes());
    bytes.extend(b"BIN\0");
    bytes.extend(&bin);
    bytes
}

/// Rays of a camera, and rays between random points of the bounds.
fn rays(bounds: Bounds3) -> [(&'static str, Vec<(DVec3, Vec3)>); 2] {
    let mut rng = Pcg64Mcg::seed_from_u64(1);
    let (middle, size) = (bounds.centre(), bounds.size());
    let eye = middle + DVec3::new(0.3, 0.2, 1.0) * size.length();
    let side = 64;
    let coherent = (0..RAYS)
        .map(|i| {
            let [x, y] = [i % side, i / side].map(|k| k as f64 / side as f64 - 0.5);
            let target = middle + DVec3::new(x, y, 0.0) * size.max_element();
            (eye, (target - eye).normalize().as_vec3())
        })
        .collect();
    let incoherent = (0..RAYS)
        .map(|_| {
            let origin = middle + direction(&mut rng) * (0.6 * size.length());
            let target = middle + direction(&mut rng) * (0.25 * size.min_element().max(0.1));
            (origin, (target - origin).normalize().as_vec3())
        })
        .collect();
    [("coherent", coherent), ("incoherent", incoherent)]
}

fn both_levels(c: &mut Criterion, name: &str, surfaces: &Surfaces) {
    let mut group = c.benchmark_group(format!("surfaces/{name}"));
    group.throughput(Throughput::Elements(RAYS as u64)).sample_size(20);
    for (kind, rays) in rays(surfaces.bounds()) {
        let mut rng = Pcg64Mcg::seed_from_u64(2);
        group.bench_function(kind, |b| {
            b.iter(|| {
                let nearest = |(origin, along): &(DVec3, Vec3)| {
                    surfaces.intersect(*origin, *along, f64::INFINITY, &mut rng).map(|hit| hit.t)
                };
                black_box(rays.iter().filter_map(nearest).sum::<f64>())
            });
        });
        group.bench_function(format!("{kind}_shadow"), |b| {
            b.iter(|| {
                let blocked = |(origin, along): &&(DVec3, Vec3)| {
                    surfaces.occluded(*origin, *along, f64::INFINITY, &mut rng)
                };
                black_box(rays.iter().filter(blocked).count())
            });
        });
    }
    group.finish();
}

/// One level, all in single precision but the test: what the trees themselves cost.
fn trees(c: &mut Criterion, triangles: &[[Vec3; 3]], bounds: Bounds3) {
    let boxes: Vec<Aabb> = triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(Vec3A::from);
            Aabb { min: a.min(b).min(c) - 2e-6, max: a.max(b).max(c) + 2e-6 }
        })
        .collect();
    let medium = BvhBuildParams::medium_build();
    let cwbvh = build_cwbvh(&boxes, medium, &mut Default::default());
    let bvh2 = build_bvh2(&boxes, medium, &mut Default::default());
    let order = |indices: &[u32]| -> Vec<[Vec3; 3]> {
        indices.iter().map(|&i| triangles[i as usize]).collect()
    };
    let (wide, binary) = (order(&cwbvh.primitive_indices), order(&bvh2.primitive_indices));
    let mut group = c.benchmark_group("trees/sphere");
    group.throughput(Throughput::Elements(RAYS as u64)).sample_size(20);
    let closest = |sheared: &ShearedRay, triangle: &[Vec3; 3], ray: &Ray| {
        sheared.intersect(triangle, f64::from(ray.tmax)).map_or(f32::INFINITY, |hit| hit.t as f32)
    };
    for (kind, rays) in rays(bounds) {
        let ray = |(origin, along): &(DVec3, Vec3)| {
            let single = Ray::new_inf(origin.as_vec3a(), Vec3A::from(*along));
            (single, ShearedRay::new(*origin, along.as_dvec3()))
        };
        group.bench_function(format!("{kind}/cwbvh"), |b| {
            b.iter(|| {
                for (ray, sheared) in rays.iter().map(ray) {
                    let mut hit = RayHit::none();
                    cwbvh.ray_traverse(ray, &mut hit, |ray, i| closest(&sheared, &wide[i], ray));
                    black_box(hit);
                }
            });
        });
        group.bench_function(format!("{kind}/bvh2"), |b| {
            b.iter(|| {
                for (ray, sheared) in rays.iter().map(ray) {
                    let mut hit = RayHit::none();
                    bvh2.ray_traverse(ray, &mut hit, |ray, i| closest(&sheared, &binary[i], ray));
                    black_box(hit);
                }
            });
        });
        group.bench_function(format!("{kind}_shadow/cwbvh"), |b| {
            b.iter(|| {
                for (ray, sheared) in rays.iter().map(ray) {
                    black_box(
                        cwbvh.ray_traverse_miss(ray, |ray, i| closest(&sheared, &wide[i], ray)),
                    );
                }
            });
        });
        group.bench_function(format!("{kind}_shadow/bvh2"), |b| {
            b.iter(|| {
                for (ray, sheared) in rays.iter().map(ray) {
                    black_box(
                        bvh2.ray_traverse_miss(ray, |ray, i| closest(&sheared, &binary[i], ray)),
                    );
                }
            });
        });
    }
    group.finish();
}

fn benches(c: &mut Criterion) {
    let studio = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/gltf/studio.glb");
    let rule = GlassRule::default();
    let (_, studio) = gltf::load_with_surfaces(studio, 683.0, rule).expect("the studio");
    both_levels(c, "studio", &studio.surfaces.expect("surfaces"));

    let triangles = sphere();
    let bytes = glb(&triangles);
    let load = || gltf::parse_with_surfaces("sphere.glb", &bytes, 683.0, rule).expect("a sphere").1;
    let sphere = load().surfaces.expect("surfaces");
    both_levels(c, "sphere", &sphere);
    trees(c, &triangles, sphere.bounds());

    let mut group = c.benchmark_group("build/sphere");
    group.sample_size(10);
    group.bench_function("load", |b| b.iter(|| black_box(load())));
    let boxes: Vec<Aabb> = triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(Vec3A::from);
            Aabb { min: a.min(b).min(c), max: a.max(b).max(c) }
        })
        .collect();
    group.bench_function("obvhs_medium_cwbvh", |b| {
        let medium = BvhBuildParams::medium_build();
        b.iter(|| black_box(build_cwbvh(&boxes, medium, &mut Default::default())));
    });
    group.finish();
}

criterion_group!(surfaces, benches);
criterion_main!(surfaces);
