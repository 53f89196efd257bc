//! What a path tells of itself beside its light and alpha.

/// What a path tells of itself, for the layers that ask: see
/// [`Reconstruction::Mean`](crate::Reconstruction::Mean).
///
/// An *event* is a scattering or an absorption, in a medium or at a surface. A path may meet its
/// first event in several places, where its channels part; `weight` and what it multiplies are then
/// sums over them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PathRecord {
    /// Throughput with which the first event was met, mean over channels: one for most paths that
    /// met any, zero for those that met none; over paths its mean is alpha.
    pub weight: f32,
    /// Distance of the first event along the camera's axis, scene units, times `weight`; of a
    /// panorama the distance from the camera.
    pub depth: f32,
    /// Place of the first event in the world, scene units, times `weight`.
    pub position: [f32; 3],
    /// Unit vector at the first event, in the world, times `weight`: the shading normal towards the
    /// viewer, or the direction in which density falls fastest, towards the viewer where it is even.
    pub normal: [f32; 3],
    /// Albedo at the first event per channel, times `weight`: of a medium that of single
    /// scattering, of a surface its base colour.
    pub albedo: [f32; 3],
    /// Share of the background that is seen past all surfaces, per channel; its mean over channels is
    /// one minus alpha.
    pub transmittance: [f32; 3],
    /// Radiance of the environment that was scattered nowhere.
    pub background: [f32; 3],
    /// Radiance of surfaces and volumes that was scattered nowhere.
    pub emission: [f32; 3],
    /// Radiance that was scattered once.
    pub direct: [f32; 3],
}

impl PathRecord {
    /// Of a path that told nothing.
    pub const EMPTY: PathRecord = PathRecord {
        weight: 0.0,
        depth: 0.0,
        position: [0.0; 3],
        normal: [0.0; 3],
        albedo: [0.0; 3],
        transmittance: [0.0; 3],
        background: [0.0; 3],
        emission: [0.0; 3],
        direct: [0.0; 3],
    };

    /// Adds radiance that was scattered so often since it left a surface or a volume.
    pub fn add_light(&mut self, radiance: [f32; 3], scatterings: u32) {
        match scatterings {
            0 => add(&mut self.emission, radiance),
            1 => add(&mut self.direct, radiance),
            // The rest of the picture.
            _ => {}
        }
    }

    /// Adds radiance of the environment that was scattered so often.
    pub fn add_light_of_environment(&mut self, radiance: [f32; 3], scatterings: u32) {
        if scatterings == 0 {
            add(&mut self.background, radiance);
        } else {
            self.add_light(radiance, scatterings);
        }
    }

    /// Adds a place where the first event was met with some throughput, `weight` as its mean over
    /// channels.
    pub fn add_first_event(&mut self, weight: f32, event: &FirstEvent) {
        self.weight += weight;
        self.depth += weight * event.depth;
        let each = [
            (&mut self.position, event.position),
            (&mut self.normal, event.normal),
            (&mut self.albedo, event.albedo),
        ];
        for (sum, value) in each {
            add(sum, value.map(|v| weight * v));
        }
    }

    /// Scales all light, as where a sample's radiance is clamped.
    pub fn scale_light(&mut self, factor: f32) {
        for light in [&mut self.background, &mut self.emission, &mut self.direct] {
            *light = light.map(|v| v * factor);
        }
    }
}

/// Where a path met its first event: see the fields of [`PathRecord`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FirstEvent {
    /// Along the camera's axis, scene units.
    pub depth: f32,
    /// In the world, scene units.
    pub position: [f32; 3],
    /// In the world, a unit vector.
    pub normal: [f32; 3],
    /// Per channel.
    pub albedo: [f32; 3],
}

fn add(sum: &mut [f32; 3], values: [f32; 3]) {
    for (sum, value) in sum.iter_mut().zip(values) {
        *sum += value;
    }
}
