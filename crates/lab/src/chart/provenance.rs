//! Where figures come from.

use serde::Serialize;

/// Machine, program and settings behind a set of figures.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Provenance {
    /// Processor and number of cores.
    pub machine: String,
    /// Version and commit of the program.
    pub program: String,
    /// Compiler and target.
    pub compiler: String,
    /// Seed of all random numbers.
    pub seed: u64,
    /// What else was set, by name.
    pub settings: Vec<(String, String)>,
}

impl Provenance {
    /// Of this machine and program.
    pub fn here(seed: u64) -> Provenance {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let processor = std::fs::read_to_string("/proc/cpuinfo")
            .ok()
            .and_then(|text| {
                let line = text.lines().find(|line| line.starts_with("model name"))?;
                Some(line.split_once(':')?.1.trim().to_owned())
            })
            .unwrap_or_else(|| std::env::consts::ARCH.to_owned());
        Provenance {
            machine: format!("{processor}, {cores} cores, {}", std::env::consts::OS),
            program: format!(
                "pileus {}, commit {}",
                env!("CARGO_PKG_VERSION"),
                env!("PILEUS_COMMIT")
            ),
            compiler: format!("{}, {}", env!("PILEUS_COMPILER"), env!("PILEUS_TARGET")),
            seed,
            settings: Vec::new(),
        }
    }

    /// Adds a setting.
    pub fn with(mut self, name: &str, value: impl ToString) -> Provenance {
        self.settings.push((name.to_owned(), value.to_string()));
        self
    }

    /// All of it as pairs.
    pub fn lines(&self) -> Vec<(String, String)> {
        let mut lines = vec![
            ("machine".to_owned(), self.machine.clone()),
            ("program".to_owned(), self.program.clone()),
            ("compiler".to_owned(), self.compiler.clone()),
            ("seed".to_owned(), self.seed.to_string()),
        ];
        lines.extend(self.settings.iter().cloned());
        lines
    }

    /// The provenance as comment lines at the head of a CSV file.
    pub fn comment(&self) -> String {
        let clean = |text: &str| text.replace(['\n', '\r'], " ");
        self.lines().iter().map(|(name, value)| format!("# {name}: {}\n", clean(value))).collect()
    }
}
