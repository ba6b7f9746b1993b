"""How the page looks: one style sheet for light, dark, narrow screens and paper."""

from s3le.show import svg

_SHEET = """
:root { color-scheme: light dark; --back: #fbfaf8; --paper: #ffffff; --ink: #222222;
  --quiet: #5c6167; --line: #dcdedf; --band: #f1f2f3; --accent: #00639c; --alarm: #b3131a;
  --own: #009e73; --bar: #a9cde3; }
@media screen and (prefers-color-scheme: dark) { :root { --back: #14171a; --paper: #1b1f24;
  --ink: #e6e8ea; --quiet: #a7aeb6; --line: #343a41; --band: #242a31; --accent: #6cbcf0;
  --alarm: #ff8a8c; --own: #2fbf95; --bar: #2d5f85; DARK } }
* { box-sizing: border-box; }
html { scroll-behavior: smooth; -webkit-text-size-adjust: 100%; }
body { margin: 0; background: var(--back); color: var(--ink);
  font: 16px/1.6 system-ui, -apple-system, "Segoe UI", Roboto, "Noto Sans", "DejaVu Sans",
  sans-serif; overflow-wrap: break-word; }
header, nav, main { max-width: 70.5rem; margin: 0 auto; padding: 0 1.25rem; min-width: 0; }
header { padding-top: 1.5rem; }
main { padding-bottom: 4rem; }
h1, h2, h3 { line-height: 1.25; font-weight: 650; text-wrap: balance; }
h1 { font-size: 2.1rem; letter-spacing: -.015em; margin: 1rem 0 .5rem; }
h2 { font-size: 1.4rem; letter-spacing: -.01em; margin: 0 0 1rem; }
h3 { font-size: 1.05rem; margin: 2rem 0 .5rem; }
p, ul { max-width: 44rem; margin: .6rem 0; }
li { margin: .4rem 0; }
a { color: var(--accent); }
code { font: .875em/1.5 ui-monospace, "SF Mono", Menlo, Consolas, "DejaVu Sans Mono", monospace;
  overflow-wrap: anywhere; }
section { margin-top: 3rem; padding-top: 1.75rem; border-top: 1px solid var(--line);
  scroll-margin-top: .5rem; }
.lead { font-size: 1.06rem; }
.quiet, .how, figcaption, footer { color: var(--quiet); }
.how, figcaption, footer { font-size: .9rem; line-height: 1.5; }
.alarm { color: var(--alarm); font-weight: 650; border-left: 3px solid; padding-left: .8rem; }
nav { margin-top: 1.6rem; font-size: .9rem; }
nav h2 { font-size: .8rem; text-transform: uppercase; letter-spacing: .06em; margin: 0 0 .4rem;
  color: var(--quiet); }
nav ol { margin: 0; padding: 0; list-style: none; display: flex; flex-wrap: wrap;
  gap: .1rem 1.1rem; }
nav li { margin: 0; }
nav a { color: var(--quiet); text-decoration: none; display: inline-block; padding: .25rem 0; }
nav a:hover, nav a:focus { color: var(--accent); text-decoration: underline; }
.cards { display: grid; grid-template-columns: repeat(auto-fit, minmax(11.5rem, 1fr));
  gap: .8rem; margin: 1.6rem 0 .8rem; }
.card { background: var(--paper); border: 1px solid var(--line); border-radius: 8px;
  padding: .9rem 1rem .8rem; display: flex; flex-direction: column; }
.card h3 { margin: 0; font-size: .88rem; line-height: 1.35; min-height: 2.7em; }
.card p { margin: 0; }
.card .quiet { font-size: .8rem; }
.big { font-size: 2rem; font-weight: 600; letter-spacing: -.02em; line-height: 1.2;
  font-variant-numeric: tabular-nums; }
.gauge { height: 5px; border-radius: 3px; background: var(--band); margin: .35rem 0 .45rem; }
.gauged { display: flex; align-items: center; gap: .6rem; min-width: 8.5rem; }
.gauged i { flex: 1; height: .55rem;
  background: linear-gradient(to left, var(--bar) var(--share), transparent 0); }
.gauge i { display: block; height: 100%; border-radius: 3px; background: var(--quiet); }
.own .gauge i { background: var(--own); }
dl { display: grid; grid-template-columns: 1fr auto; gap: .1rem .6rem; margin: .6rem 0 0;
  padding-top: .5rem; border-top: 1px solid var(--line); font-size: .8rem; }
dt { color: var(--quiet); }
dd { margin: 0; text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
figure { margin: 1rem 0 1.6rem; }
figcaption { margin-top: .6rem; }
figcaption p { margin: .3rem 0; }
.how b, figcaption b { font-weight: 600; color: var(--ink); }
.scroll { overflow-x: auto; max-width: 100%; }
.scroll:focus-visible, summary:focus-visible, a:focus-visible { outline: 2px solid var(--accent);
  outline-offset: 2px; border-radius: 2px; }
table { border-collapse: collapse; font-size: .88rem; line-height: 1.4;
  font-variant-numeric: tabular-nums; }
th, td { padding: .42rem .75rem; text-align: left; vertical-align: top;
  border-bottom: 1px solid var(--line); }
th:first-child { padding-left: .15rem; }
thead th { vertical-align: bottom; color: var(--quiet); font-weight: 600;
  border-bottom: 1.5px solid var(--quiet); max-width: 11rem; }
tbody th { font-weight: 500; min-width: 9rem; }
th.n, td.n { text-align: right; }
td.n { white-space: nowrap; }
.words { min-width: 38rem; }
td code, th code { overflow-wrap: break-word; }
thead th.n { min-width: 5.6rem; }
tbody tr:hover { background: var(--band); }
details { margin: .5rem 0; }
summary { cursor: pointer; color: var(--accent); width: fit-content; padding: .15rem 0; }
figcaption details { margin: .2rem 0; }
.media { background: var(--paper); border: 1px solid var(--line); border-radius: 8px;
  padding: .9rem; }
.painted { background: #ffffff; }
.media img, .media svg { display: block; width: 100%; height: auto; }
.drawn { margin: 0 auto; }
footer { margin-top: 4rem; padding-top: 1rem; border-top: 1px solid var(--line); }
@media screen and (min-width: 84rem) {
  body { display: grid; grid-template-columns: 13rem minmax(0, 70.5rem); column-gap: 1rem;
    justify-content: center; }
  header, main { grid-column: 2; margin: 0; width: 100%; }
  nav { grid-column: 1; grid-row: 1 / span 2; position: sticky; top: 0; align-self: start;
    max-height: 100vh; overflow-y: auto; padding: 2.9rem 0 1rem 1rem; margin: 0; }
  nav ol { display: block; }
}
@media (max-width: 40rem) {
  body { font-size: 15.5px; }
  header, nav, main { padding-left: 1rem; padding-right: 1rem; }
  header { padding-top: .5rem; }
  h1 { font-size: 1.7rem; }
  .cards { grid-template-columns: 1fr 1fr; gap: .6rem; }
  .card:first-child { grid-column: 1 / -1; }
  .card h3 { min-height: 0; }
  .card { padding: .7rem .75rem; }
  .big { font-size: 1.6rem; }
  .media { padding: .5rem; }
}
@media (prefers-reduced-motion: reduce) { html { scroll-behavior: auto; } }
@media print {
  body { background: #ffffff; font-size: 10pt; }
  nav { display: none; }
  header, main { max-width: none; padding: 0; }
  .scroll { overflow: visible; }
  .scroll > * { min-width: 0 !important; }
  table { font-size: 7.5pt; }
  .words, .gauged, thead th.n, tbody th { min-width: 0; }
  .gauged { display: inline; }
  .gauged i { display: none; }
  th, td { padding: .2rem .35rem; }
  .media, .card, tr, figcaption { break-inside: avoid; }
  h2, h3 { break-after: avoid; }
  .media { border: 0; padding: 0; }
}
"""


def sheet() -> str:
    """The style sheet; in the dark it gives every colour of a chart its twin (svg.DARK)."""
    twins = " ".join(f"{svg.variable(old)}: {new};" for old, new in svg.DARK.items())
    return _SHEET.replace("DARK", twins).strip()
