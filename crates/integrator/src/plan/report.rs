//! How a plan reads: the one place that prints it.

use super::Plan;
use std::fmt;

impl fmt::Display for Plan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "kernel         {}", self.kernel)?;
        writeln!(f, "distance       {}", self.distance.name())?;
        writeln!(f, "transmittance  {}", self.transmittance.name())?;
        writeln!(f, "majorants      {}", self.majorants)?;
        if self.majorant_scale != 1.0 {
            writeln!(f, "               times {}", self.majorant_scale)?;
        }
        writeln!(
            f,
            "shadow rays    to {} lights{}",
            self.shadow_ray_lights,
            if self.mis { ", weighted" } else { "" }
        )?;
        match self.max_bounces {
            Some(n) => writeln!(f, "bounces        at most {n}")?,
            None => writeln!(f, "bounces        unlimited")?,
        }
        match self.max_events {
            Some(n) => writeln!(f, "events         at most {n} a path")?,
            None => writeln!(f, "events         unlimited")?,
        }
        for volume in &self.volumes {
            writeln!(
                f,
                "volume         {}: {}{}, sigma_t up to {:.4}{}, phase {}, albedo {}{}",
                volume.name,
                volume.kind,
                if volume.grey { "" } else { " per channel" },
                volume.sigma_t_max,
                volume.transmittance_function.as_ref().map_or(String::new(), |function| format!(
                    ", transmittance function {function}"
                )),
                volume.phase,
                volume.albedo,
                volume.voxels.map_or(String::new(), |v| format!(
                    ", {v} voxels, {:.1} MB",
                    volume.bytes as f64 / 1e6
                )),
            )?;
        }
        for item in &self.biased {
            writeln!(f, "biased         {item}")?;
        }
        for reason in &self.reasons {
            writeln!(f, "because        {reason}")?;
        }
        for item in &self.not_modelled {
            writeln!(f, "not modelled   {item}")?;
        }
        for item in &self.warnings {
            writeln!(f, "warning        {item}")?;
        }
        Ok(())
    }
}
