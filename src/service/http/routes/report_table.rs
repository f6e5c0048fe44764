//! Tables and lengths of the report's page.

use maud::{Markup, html};

/// A table with a title; nothing without rows.
pub(super) fn table(title: &str, names: &[&str], rows: impl IntoIterator<Item = Vec<String>>) -> Markup {
    let mut rows = rows.into_iter().peekable();
    html! {
        @if rows.peek().is_some() {
            h2 { (title) }
            table {
                tr { @for name in names { th { (name) } } }
                @for row in rows { tr { @for cell in row { td { (cell) } } } }
            }
        }
    }
}

/// Formats a length to 0.01 mm, without a negative zero.
pub(super) fn mm(value: f64) -> String {
    let text = format!("{value:.2}");
    if text == "-0.00" { "0.00".to_owned() } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_moves_by_minus_zero() {
        assert_eq!([mm(-0.004), mm(0.0), mm(-0.006)], ["0.00", "0.00", "-0.01"]);
    }

    #[test]
    fn text_cannot_become_markup() {
        let page = table("<script>\"&\"", &["a"], [vec!["<b>".to_owned()]]).into_string();
        assert!(page.contains("&lt;script&gt;&quot;&amp;&quot;") && page.contains("&lt;b&gt;"), "{page}");
    }
}
