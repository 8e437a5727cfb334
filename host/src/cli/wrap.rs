//! Lines that are as long as the terminal is wide.

use textwrap::Options;

/// Columns within which a line's label ends, as `gap      ` or `which    `.
const LABEL: usize = 12;

/// `text` with lines of `width` columns at most; what a line goes on with stands below what follows its label. Rows of tables,
/// which have several gaps of two blanks or more, stay as they are.
pub(super) fn wrapped(text: &str, width: usize) -> String {
    let lines: Vec<String> = text.split('\n').map(|line| of_line(line, width)).collect();
    lines.join("\n")
}

fn of_line(line: &str, width: usize) -> String {
    let words = line.trim_start_matches(' ');
    let margin = line.len() - words.len();
    let label = words.find("  ").map(|end| {
        let gap = words[end..].len() - words[end..].trim_start_matches(' ').len();
        end + gap
    });
    let label = label.filter(|label| margin + label <= LABEL);
    let rest = &words[label.unwrap_or(0)..];
    if textwrap::core::display_width(line) <= width || rest.contains("  ") {
        return line.to_owned();
    }
    let hanging = " ".repeat(margin + label.unwrap_or(2));
    let first = &line[..line.len() - rest.len()];
    let options = Options::new(width)
        .initial_indent(first)
        .subsequent_indent(&hanging)
        .break_words(false);
    textwrap::fill(rest, options)
}

#[cfg(test)]
mod tests {
    use super::wrapped;

    #[test]
    fn a_long_line_goes_on_below_what_follows_its_label() {
        let line = "gap      the nominal model misses by 9.96 times the stated noise";
        assert_eq!(
            wrapped(line, 40),
            "gap      the nominal model misses by\n         9.96 times the stated noise"
        );
        assert_eq!(wrapped(line, 80), line);
    }

    #[test]
    fn a_sentence_goes_on_two_columns_further_and_a_margin_stays() {
        assert_eq!(wrapped("one two three", 8), "one two\n  three");
        assert_eq!(wrapped("  one two three", 10), "  one two\n    three");
    }

    #[test]
    fn rows_of_tables_and_long_words_stay_whole() {
        let row = "k2        -4.2e-4   1.1e-6   g/g^2   determined";
        assert_eq!(wrapped(row, 20), row);
        assert_eq!(
            wrapped("file abcdefghijklmnop", 10),
            "file\n  abcdefghijklmnop"
        );
    }
}
