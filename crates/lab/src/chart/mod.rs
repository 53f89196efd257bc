//! Charts: tables and curves with where they come from, written as CSV, SVG, PNG and one page of
//! HTML.

mod page;
mod plot;
mod provenance;
mod table;

pub use plot::{Axis, Plot, Series};
pub use provenance::Provenance;
pub use table::{Cell, Table};

use crate::Error;
use pileus_film::{png_bytes, write_atomically};
use std::io::Write;
use std::path::{Path, PathBuf};

/// An image on a page.
#[derive(Debug, Clone)]
pub struct Picture {
    /// What it shows.
    pub caption: String,
    /// PNG file.
    pub png: Vec<u8>,
}

/// Everything that one experiment has to show.
#[derive(Debug, Clone)]
pub struct Chart {
    /// File name without extension.
    pub name: String,
    /// Headline.
    pub title: String,
    /// What was done, a paragraph each.
    pub notes: Vec<String>,
    /// Where the figures come from.
    pub provenance: Provenance,
    /// All figures.
    pub table: Table,
    /// Curves.
    pub plots: Vec<Plot>,
    /// Images.
    pub pictures: Vec<Picture>,
}

impl Chart {
    /// Writes `NAME.csv`, `NAME-PLOT.svg`, `NAME-PLOT.png` and `NAME.html` into a folder, which is
    /// made if it is not there.
    ///
    /// # Errors
    /// If a file cannot be written or a plot cannot be drawn.
    pub fn write(&self, folder: &Path) -> Result<Vec<PathBuf>, Error> {
        std::fs::create_dir_all(folder).map_err(|source| {
            let place = folder.display().to_string();
            Error::Film(pileus_film::Error::Io { place, action: "make this folder", source })
        })?;
        let mut written = Vec::new();
        let mut put = |name: String, bytes: &[u8]| -> Result<(), Error> {
            let path = folder.join(name);
            write_atomically(&path, |out| out.write_all(bytes))?;
            written.push(path);
            Ok(())
        };
        let csv = format!("{}{}", self.provenance.comment(), self.table.csv());
        put(format!("{}.csv", self.name), csv.as_bytes())?;
        for plot in &self.plots {
            put(format!("{}-{}.svg", self.name, plot.name), plot.svg()?.as_bytes())?;
            let (rgb8, width, height) = plot.rgb8()?;
            let png = png_bytes(&rgb8, width, height)?;
            put(format!("{}-{}.png", self.name, plot.name), &png)?;
        }
        put(format!("{}.html", self.name), page::html(self)?.as_bytes())?;
        Ok(written)
    }
}
