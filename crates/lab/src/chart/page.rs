//! One page of HTML with everything in it: nothing is fetched when it is opened.

use super::Chart;
use crate::Error;
use base64::Engine;
use serde_json::json;

/// The page of a chart.
pub(super) fn html(chart: &Chart) -> Result<String, Error> {
    let json = |value: serde_json::Value| {
        // "</script>" must not end the script that holds the data.
        value.to_string().replace('<', "\\u003c")
    };
    let pictures: String = chart
        .pictures
        .iter()
        .map(|picture| {
            let data = base64::engine::general_purpose::STANDARD.encode(&picture.png);
            format!(
                "<figure><img src=\"data:image/png;base64,{data}\" alt=\"\"><figcaption>{}</figcaption></figure>\n",
                escaped(&picture.caption)
            )
        })
        .collect();
    let notes: String = chart.notes.iter().map(|n| format!("<p>{}</p>\n", escaped(n))).collect();
    let provenance: String = chart
        .provenance
        .lines()
        .iter()
        .map(|(name, value)| format!("<dt>{}</dt><dd>{}</dd>\n", escaped(name), escaped(value)))
        .collect();
    Ok(PAGE
        .replace("{title}", &escaped(&chart.title))
        .replace("{notes}", &notes)
        .replace("{provenance}", &provenance)
        .replace("{pictures}", &pictures)
        .replace("{plots}", &json(json!(chart.plots)))
        .replace("{table}", &json(json!(chart.table))))
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

const PAGE: &str = include_str!("page.html");
