//! Tables of numbers as text: two lines of heads, then a line for each row.

use std::fmt;

/// A column, to the right of the names.
pub struct Column<'a, R> {
    head: [String; 2],
    width: usize,
    text: Box<dyn Fn(&R) -> String + 'a>,
}

/// Creates a column. `text` formats the value of a row.
pub fn column<'a, R>(head: [&str; 2], width: usize, text: impl Fn(&R) -> String + 'a) -> Column<'a, R> {
    Column { head: head.map(str::to_owned), width, text: Box::new(text) }
}

/// Formats a figure, or a dash.
pub fn number(value: impl Into<Option<f64>>, digits: usize) -> String {
    match value.into() {
        Some(value) if value.is_finite() => format!("{value:.digits$}"),
        _ => "-".to_owned(),
    }
}

/// Writes a table. The names are `width` characters wide and have the head `name`. An empty first line of heads is
/// left out.
pub fn write<'r, R: 'r>(
    f: &mut impl fmt::Write,
    (name, width): (&str, usize),
    columns: &[Column<'_, R>],
    rows: impl Iterator<Item = (&'r str, &'r R)>,
) -> fmt::Result {
    for line in 0..2 {
        if columns.iter().all(|column| column.head[line].is_empty()) {
            continue;
        }
        write!(f, "{:<width$}", if line == 1 { name } else { "" })?;
        columns.iter().try_for_each(|column| write!(f, " {:>1$}", column.head[line], column.width))?;
        writeln!(f)?;
    }
    for (name, row) in rows {
        write!(f, "{name:<width$}")?;
        columns.iter().try_for_each(|column| write!(f, " {:>1$}", (column.text)(row), column.width))?;
        writeln!(f)?;
    }
    Ok(())
}
