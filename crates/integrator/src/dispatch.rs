//! The one place where a plan turns into a compiled kernel.

use crate::error::{Error, Parameter, Remedy};
use crate::kernel::{CameraMedia, Kernel, PathLimits, VolumesAndSurfaces, VolumesOnly, World};
use crate::lights::Lights;
use crate::media::channels::{ChannelMode, Grey, Spectral, Split};
use crate::media::{
    AnyPhase, IsotropicOrHenyeyGreenstein, Media, MediaIndex, Merged, NoMedia, OneGrid, PhaseAxis,
};
use crate::plan::thickness::typical_sigma_t;
use crate::plan::{self, Channels, Events, PhaseFunctions, Plan, extinguishes};
use crate::prepass::RadianceCache;
use crate::settings::RenderSettings;
use pileus_media::Medium;
use pileus_media::distance::DistanceSampler;
use pileus_media::emission::EmissionField;
use pileus_media::kernel::{GridShape, Voxel, VoxelKernel};
use pileus_media::majorant::MajorantStructure;
use pileus_media::transmittance::DebiasingSeries;
use pileus_scene::Scene;
use std::marker::PhantomData;
use std::sync::Arc;

/// The media of a scene that have any extinction, with the majorants that the settings ask for.
#[derive(Debug)]
pub(crate) struct PlannedMedia {
    pub(crate) media: Vec<Arc<Medium>>,
    pub(crate) index: MediaIndex,
}

impl PlannedMedia {
    pub(crate) fn new(scene: &Scene, settings: &RenderSettings) -> Result<PlannedMedia, Error> {
        let (structure, factor) = (settings.majorants, settings.majorant_scale);
        let default = structure == MajorantStructure::default() && factor == 1.0;
        let media: Vec<Arc<Medium>> = scene
            .volumes
            .iter()
            .filter(|volume| extinguishes(&volume.medium))
            .map(|volume| {
                if default {
                    return Ok(Arc::clone(&volume.medium));
                }
                volume.medium.with_majorants(structure, factor).map(Arc::new).map_err(|error| {
                    Error::Parameter {
                        parameter: Parameter::MajorantScale,
                        value: factor.to_string(),
                        why: format!("volume `{}`: {error}", volume.name),
                        remedies: vec![Remedy::Default(&[
                            Parameter::Majorants,
                            Parameter::MajorantScale,
                        ])],
                    }
                })
            })
            .collect::<Result<_, Error>>()?;
        let index = MediaIndex::new(&media);
        Ok(PlannedMedia { media, index })
    }
}

/// What kernels are made of.
#[derive(Clone, Copy)]
pub(crate) struct Parts<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) plan: &'a Plan,
    pub(crate) settings: &'a RenderSettings,
    pub(crate) media: &'a PlannedMedia,
    pub(crate) lights: &'a Lights,
    pub(crate) radiance_cache: Option<&'a RadianceCache>,
    pub(crate) limits: PathLimits<'a>,
}

/// Work that is compiled for each kernel.
pub(crate) trait Job {
    type Output;
    fn run<M: Media, W: World>(&mut self, kernel: &Kernel<'_, M, W>) -> Self::Output;
}

impl<'a> Parts<'a> {
    /// Runs a job with the plan's kernel.
    pub(crate) fn with_planned_kernel<J: Job>(&self, job: &mut J) -> J::Output {
        let kernel = self.plan.kernel;
        match (kernel.events, kernel.channels) {
            (Events::None, _) => self.with_world(NoMedia, job),
            (Events::OneGrid, _) => self.with_one_grid(job),
            (Events::MergedList, Channels::Grey) => self.with_world(self.merged(Grey), job),
            (Events::MergedList, Channels::Split) => {
                self.with_world(self.merged(self.split()), job)
            }
            (Events::MergedList, Channels::Spectral) => {
                self.with_world(self.merged(self.spectral()), job)
            }
        }
    }

    /// Runs a job with the kernel that every scene can run: a merged list, split where the plan
    /// says so, beside surfaces.
    pub(crate) fn with_general_kernel<J: Job>(&self, job: &mut J) -> J::Output {
        if self.plan.kernel.channels == Channels::Split {
            return job.run(&self.kernel(
                self.merged(self.split()),
                self.volumes_and_surfaces(&self.emissive_volumes()),
            ));
        }
        self.with_coupled_kernel(job)
    }

    /// Runs a job with the kernel that every scene can run, of channels that do not decouple.
    pub(crate) fn with_coupled_kernel<J: Job>(&self, job: &mut J) -> J::Output {
        let emissive_volumes = self.emissive_volumes();
        let world = self.volumes_and_surfaces(&emissive_volumes);
        job.run(&self.kernel(self.merged(self.spectral()), world))
    }

    fn split(&self) -> Split {
        Split { weighted: self.plan.mis }
    }

    fn spectral(&self) -> Spectral {
        Spectral { by_throughput: self.plan.methods.distance != DistanceSampler::Delta }
    }

    fn merged<C: ChannelMode>(&self, channels: C) -> Merged<'a, C> {
        Merged::new(
            (&self.media.media, &self.media.index),
            self.plan.methods,
            channels,
            DebiasingSeries::with_exponent(self.settings.continuation_exponent),
        )
    }

    fn with_one_grid<J: Job>(&self, job: &mut J) -> J::Output {
        match self.media.media.as_slice() {
            [medium] if let Some(grid) = medium.default_grid() => {
                grid.with_voxels(OnVoxels { parts: self, medium, grid, job })
            }
            // The plan chose one grid: there is no other case.
            _ => self.with_world(self.merged(Grey), job),
        }
    }

    fn emissive_volumes(&self) -> Vec<Arc<EmissionField>> {
        self.scene.emissive_volumes().cloned().collect()
    }

    fn volumes_and_surfaces<'w>(
        &self,
        emissive_volumes: &'w [Arc<EmissionField>],
    ) -> VolumesAndSurfaces<'w>
    where
        'a: 'w,
    {
        let surfaces = self.scene.surfaces.as_deref();
        let margin = f64::from(self.settings.filter.radius());
        let camera_in = CameraMedia::new(surfaces, &self.scene.camera, margin);
        VolumesAndSurfaces { surfaces, emissive_volumes, camera_in }
    }

    fn with_world<J: Job, M: Media>(&self, media: M, job: &mut J) -> J::Output {
        match self.plan.kernel.world {
            plan::World::Volumes => job.run(&self.kernel(media, VolumesOnly)),
            plan::World::VolumesAndSurfaces => {
                let emissive_volumes = self.emissive_volumes();
                job.run(&self.kernel(media, self.volumes_and_surfaces(&emissive_volumes)))
            }
        }
    }

    fn kernel<M: Media, W: World>(&self, media: M, world: W) -> Kernel<'a, M, W> {
        let plan = self.plan;
        Kernel {
            media,
            world,
            lights: self.lights,
            environment: &self.scene.environment,
            limits: self.limits,
            mis: plan.mis,
            equiangular: plan.equiangular,
            typical_sigma_t: if plan.equiangular { typical_sigma_t(self.scene) } else { 0.0 },
            analog_flights: plan.analog_flights,
            radiance_cache: self.radiance_cache,
        }
    }
}

/// The kernels of one grid, waiting for its voxel type.
struct OnVoxels<'p, 'a, J> {
    parts: &'p Parts<'a>,
    medium: &'p Medium,
    grid: &'p GridShape,
    job: &'p mut J,
}

impl<J: Job> VoxelKernel for OnVoxels<'_, '_, J> {
    type Output = J::Output;

    fn run<V: Voxel>(self, voxels: &[V]) -> J::Output {
        let OnVoxels { parts, medium, grid, job } = self;
        let grid = OfGrid { parts, medium, grid, voxels };
        let kernel = parts.plan.kernel;
        match (kernel.channels == Channels::Grey, kernel.phase) {
            (true, PhaseFunctions::IsotropicOrHenyeyGreenstein) => {
                grid.run::<_, IsotropicOrHenyeyGreenstein, _>(Grey, job)
            }
            (true, PhaseFunctions::Any) => grid.run::<_, AnyPhase, _>(Grey, job),
            (false, PhaseFunctions::IsotropicOrHenyeyGreenstein) => {
                grid.run::<_, IsotropicOrHenyeyGreenstein, _>(parts.split(), job)
            }
            (false, PhaseFunctions::Any) => grid.run::<_, AnyPhase, _>(parts.split(), job),
        }
    }
}

/// A grid with its voxels in their type.
struct OfGrid<'p, 'a, V> {
    parts: &'p Parts<'a>,
    medium: &'p Medium,
    grid: &'p GridShape,
    voxels: &'p [V],
}

impl<V: Voxel> OfGrid<'_, '_, V> {
    fn run<C: ChannelMode, P: PhaseAxis, J: Job>(&self, channels: C, job: &mut J) -> J::Output {
        let OfGrid { parts, medium, grid, voxels } = *self;
        let media = OneGrid { medium, grid, voxels, channels, phase: PhantomData::<P> };
        parts.with_world(media, job)
    }
}
