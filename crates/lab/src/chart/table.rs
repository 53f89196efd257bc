//! Tables of figures.

use serde::Serialize;

/// A cell.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Cell {
    /// Words.
    Text(String),
    /// A whole number.
    Count(u64),
    /// A figure; what is not finite is written as `nan`, `inf` or `-inf`.
    Number(#[serde(serialize_with = "as_json")] f64),
}

fn as_json<S: serde::Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    if value.is_finite() {
        serializer.serialize_f64(*value)
    } else {
        serializer.serialize_str(&text_of(*value))
    }
}

fn text_of(value: f64) -> String {
    if value.is_nan() {
        "nan".into()
    } else if value.is_infinite() {
        if value > 0.0 { "inf".into() } else { "-inf".into() }
    } else if value == 0.0 || (1e-3..1e6).contains(&value.abs()) {
        let digits = if value == 0.0 { 0.0 } else { value.abs().log10().floor() };
        let decimals = (4.0 - digits).clamp(0.0, 8.0) as usize;
        let text = format!("{value:.decimals$}");
        if text.contains('.') {
            text.trim_end_matches('0').trim_end_matches('.').to_owned()
        } else {
            text
        }
    } else {
        format!("{value:.4e}")
    }
}

impl Cell {
    /// The cell as it is printed.
    pub fn text(&self) -> String {
        match self {
            Cell::Text(text) => text.clone(),
            Cell::Count(count) => count.to_string(),
            Cell::Number(value) => text_of(*value),
        }
    }
}

impl From<&str> for Cell {
    fn from(text: &str) -> Cell {
        Cell::Text(text.to_owned())
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Cell {
        Cell::Text(text)
    }
}

impl From<f64> for Cell {
    fn from(value: f64) -> Cell {
        Cell::Number(value)
    }
}

impl From<u64> for Cell {
    fn from(count: u64) -> Cell {
        Cell::Count(count)
    }
}

/// Rows of cells under named columns.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Table {
    /// Names.
    pub columns: Vec<String>,
    /// Rows, each as long as the columns.
    pub rows: Vec<Vec<Cell>>,
}

impl Table {
    /// An empty table.
    pub fn new(columns: &[&str]) -> Table {
        Table { columns: columns.iter().map(|c| (*c).to_owned()).collect(), rows: Vec::new() }
    }

    /// Adds a row.
    pub fn push(&mut self, row: Vec<Cell>) {
        debug_assert_eq!(row.len(), self.columns.len());
        self.rows.push(row);
    }

    /// Comma-separated values (RFC 4180), with a header.
    pub fn csv(&self) -> String {
        let quoted = |text: &str| {
            if text.contains([',', '"', '\n', '\r', '#']) {
                format!("\"{}\"", text.replace('"', "\"\""))
            } else {
                text.to_owned()
            }
        };
        let line = |cells: Vec<String>| {
            cells.iter().map(|c| quoted(c)).collect::<Vec<_>>().join(",") + "\n"
        };
        let mut csv = line(self.columns.clone());
        for row in &self.rows {
            csv += &line(row.iter().map(Cell::text).collect());
        }
        csv
    }

    /// A table of Markdown.
    pub fn markdown(&self) -> String {
        let escaped = |text: &str| text.replace('|', "\\|");
        let line = |cells: Vec<String>| {
            format!("| {} |\n", cells.iter().map(|c| escaped(c)).collect::<Vec<_>>().join(" | "))
        };
        let mut markdown = line(self.columns.clone());
        markdown += &line(self.columns.iter().map(|_| "---".to_owned()).collect());
        for row in &self.rows {
            markdown += &line(row.iter().map(Cell::text).collect());
        }
        markdown
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_are_short_and_text_is_quoted() {
        let mut table = Table::new(&["a", "b, c"]);
        table.push(vec![Cell::Number(0.25), "x \"y\"".into()]);
        table.push(vec![Cell::Number(f64::NAN), Cell::Number(1.234_567_8e-9)]);
        table.push(vec![Cell::Number(1234.5678), Cell::Count(7)]);
        assert_eq!(table.csv(), "a,\"b, c\"\n0.25,\"x \"\"y\"\"\"\nnan,1.2346e-9\n1234.6,7\n");
        assert!(table.markdown().contains("| 0.25 | x \"y\" |"));
        assert!(serde_json::to_string(&table).unwrap().contains("\"nan\""));
    }
}
