//! The frame of every page: HTML without scripts and without anything from outside, good to read in bright and dark, on a
//! narrow screen, and on paper.

use maud::{DOCTYPE, Markup, PreEscaped, html};

const STYLE: &str = "
:root { color-scheme: light dark; --ink: #222; --soft: #444; --paper: #fff; --line: #ddd; --strong: #999;
  --note: #eef5fa; --bad: #fdf1e8; --good: #eaf6f1; --blue: #0072b2; --orange: #d55e00; --green: #007a59; }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 50rem; padding: 1.5rem 1.2rem 3rem; background: var(--paper); color: var(--ink);
  font: 16px/1.5 system-ui, -apple-system, 'Segoe UI', 'DejaVu Sans', sans-serif; overflow-wrap: break-word; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: 0 0 .3rem; }
h2 { font-size: 1.25rem; margin: 2.4rem 0 .5rem; padding-top: .6rem; border-top: 2px solid var(--line); }
p { margin: .5rem 0; }
a { color: var(--blue); }
.lead { font-size: 1.08rem; }
.contents ol { columns: 2 16rem; margin: .3rem 0 1rem; padding-left: 1.4rem; font-size: .93rem; }
.verdict { display: inline-block; padding: 0 .5rem; border-radius: .2rem; font-weight: 600; background: var(--note); }
.verdict.pass { background: var(--good); color: var(--green); }
.verdict.fail { background: var(--bad); color: var(--orange); }
.remark { border-left: 6px solid var(--blue); background: var(--note); padding: .6rem 1rem; margin: .8rem 0; }
.remark.warning { border-color: var(--orange); background: var(--bad); }
.remark h3 { margin: 0; font-size: 1.02rem; }
.remark p { margin: .2rem 0 0; }
figure { margin: 1rem 0 1.4rem; }
figure svg { max-width: 100%; height: auto; }
figure div > svg { display: block; }
.pair { display: flex; flex-wrap: wrap; }
.pair > svg { flex: 1 1 18rem; min-width: 0; max-width: 50%; }
.legend { display: flex; flex-wrap: wrap; gap: .1rem 1.3rem; list-style: none; margin: .2rem 0 .3rem; padding: 0;
  font-size: .88rem; }
.legend li { display: flex; align-items: center; gap: .45rem; }
figcaption { font-size: .93rem; color: var(--soft); }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: .9rem; margin: .6rem 0; font-variant-numeric: tabular-nums; }
caption { text-align: left; font-size: .93rem; color: var(--soft); padding-bottom: .3rem; }
th, td { padding: .2rem .7rem; border-bottom: 1px solid var(--line); text-align: left; vertical-align: top; }
th { border-bottom: 2px solid var(--strong); vertical-align: bottom; }
.head th { border-bottom: 1px solid var(--line); font-weight: 600; vertical-align: top; white-space: nowrap; }
.full td, .full th { padding: .2rem .4rem; }
.hash { font-family: ui-monospace, monospace; font-size: .85em; overflow-wrap: anywhere; }
sub, sup { line-height: 0; font-size: .75em; }
.number { text-align: right; white-space: nowrap; }
.far { background: var(--bad); font-weight: 600; }
.bar { display: inline-block; height: .8em; background: var(--blue); }
td:has(.bar) { white-space: nowrap; }
.matrix td { text-align: center; min-width: 3.2rem; }
footer { margin-top: 2.5rem; border-top: 1px solid var(--line); padding-top: .6rem; font-size: .85rem; color: var(--soft); }
@media screen and (prefers-color-scheme: dark) {
  :root { --ink: #e4e4e4; --soft: #b8b8b8; --paper: #141414; --line: #3a3a3a; --strong: #777; --note: #16242e; --bad: #33200f;
    --good: #10281f; --blue: #5ab4e5; --orange: #ff9a4d; --green: #4fd0a4; }
  figure svg { filter: invert(.92) hue-rotate(180deg); }
}
@media screen and (max-width: 40rem) {
  body { padding: 1rem .8rem 2rem; }
  .pair > svg { max-width: 100%; }
  .head th { white-space: normal; }
  .fold thead { display: none; }
  .fold, .fold tbody, .fold tr, .fold caption { display: block; }
  .fold tr { border: 1px solid var(--line); margin: .5rem 0; padding: .2rem .5rem; }
  .fold td { display: flex; justify-content: space-between; gap: 1rem; border: 0; padding: .05rem 0; white-space: normal; }
  .fold td::before { content: attr(data-label); color: var(--soft); text-align: left; }
}
@media print {
  @page { size: A4; margin: 14mm; }
  body { max-width: none; padding: 0; font-size: 10pt; }
  h2 { break-after: avoid; margin-top: 1.2rem; }
  figure div > svg, .pair, .remark, tr { break-inside: avoid; }
  figure svg { max-height: 100mm; width: auto; }
  .legend { break-after: avoid; break-inside: avoid; }
  thead { display: table-header-group; }
  .wide { overflow: visible; }
  .full { width: 100%; font-size: 7.5pt; }
  .full td, .full th { padding: .1rem .25rem; }
  .contents { display: none; }
  * { print-color-adjust: exact; -webkit-print-color-adjust: exact; }
}
";

/// A section of a page.
pub(super) struct Section {
    /// Its anchor.
    pub id: &'static str,
    /// Its heading.
    pub title: &'static str,
    /// What stands under it.
    pub body: Markup,
}

/// A whole page: what stands first, a table of contents, the sections, and the foot.
pub(super) fn page(title: &str, first: &Markup, sections: &[Section], foot: &Markup) -> String {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title) }
                style { (PreEscaped(STYLE)) }
            }
            body {
                h1 { (title) }
                (first)
                @if sections.len() > 2 {
                    nav.contents aria-label="Contents" {
                        ol { @for section in sections { li { a href=(format!("#{}", section.id)) { (section.title) } } } }
                    }
                }
                @for section in sections {
                    section aria-labelledby=(section.id) {
                        h2 id=(section.id) { (section.title) }
                        (section.body)
                    }
                }
                footer { "vre " (env!("CARGO_PKG_VERSION")) ", " (foot) }
            }
        }
    }
    .into_string()
}
