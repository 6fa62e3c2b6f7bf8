"""The style sheet of the page: readable on a phone, in the dark and on paper."""

CSS = """
:root { --paper: #fff; --ink: #1c1c1c; --soft: #5c5c5c; --rule: #d8d8d8; --box: #f4f4f2;
  --before: #c25100; --after: #0068a3; --other: #9a9a9a; --good: #00704f; --warn: #8a4b00;
  --refit: #8a4fa0; }
@media (prefers-color-scheme: dark) { :root { --paper: #15171a; --ink: #e8e8e6; --soft: #a5a8ac;
  --rule: #3a3d42; --box: #1f2226; --before: #ff9a4d; --after: #5ab8f0; --other: #6f747b;
  --good: #4fd1a5; --warn: #ffc174; --refit: #d19be3; } }
* { box-sizing: border-box }
body { font: 16px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--paper);
  max-width: 60rem; margin: 0 auto; padding: 1rem; overflow-wrap: break-word }
h1 { font-size: 1.5rem; line-height: 1.25; margin: .6rem 0 } h2 { font-size: 1.2rem;
  margin: 2.4rem 0 .6rem; border-top: 1px solid var(--rule); padding-top: 1rem }
h3 { font-size: 1.02rem; margin: 1.6rem 0 .4rem }
a { color: var(--after) } p, li { max-width: 46rem } .soft { color: var(--soft); font-size: .9rem }
.verdict, .cause { background: var(--box); border-left: 5px solid var(--other);
  padding: .8rem 1rem; margin: 1rem 0; border-radius: 4px }
.verdict p, .cause p { margin: .35rem 0 } .big { font-size: 1.08rem }
.verdict .big { font-weight: 600 } .verdict li { margin: .4rem 0 }
.good { border-color: var(--good) } .found { border-color: var(--after) }
.bad { border-color: var(--before) }
.notice { border-left: 3px solid var(--warn); padding-left: .7rem }
nav { font-size: .92rem } nav a { margin-right: 1rem; white-space: nowrap }
.figures { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(17rem, 100%), 1fr));
  gap: 1rem 1.4rem }
.pair { display: grid; gap: 0 1.6rem;
  grid-template-columns: repeat(auto-fit, minmax(min(24rem, 100%), 1fr)) }
figure { margin: .4rem 0; break-inside: avoid }
figcaption { font-size: .9rem; margin-bottom: .2rem }
img { max-width: 100%; height: auto; background: #fff }
svg { width: 100%; height: auto; display: block } svg.key { width: 14px; height: 14px;
  display: inline-block; vertical-align: -2px; margin-right: .35rem }
.t { font: 12px system-ui, sans-serif; fill: var(--ink) } .grid { stroke: var(--rule) }
.zero { stroke: var(--soft) } .tick { stroke: var(--soft) }
.line { fill: none; stroke-width: 2 } .whisker { stroke-width: 1.2 } .mark { stroke: none }
.before { stroke: var(--before) } .before.mark, .before.bar { fill: var(--before) }
.after { stroke: var(--after) } .after.mark, .after.bar { fill: var(--after) }
.refit { stroke: var(--refit) } .refit.mark, .refit.bar { fill: var(--refit) }
.car { stroke: var(--ink) } .car.mark { fill: var(--ink) }
.path.before { stroke-dasharray: 8 4 } .path.refit { stroke-dasharray: 3 3 }
.path.car { stroke-width: 7; opacity: .3 }
.line.before, .line.after { fill: none } .bar { stroke: none } .other.bar { fill: var(--other) }
.floor.bar, .key .floor { fill: none; stroke: var(--ink) } .key .refit { fill: var(--refit) }
.median { stroke: var(--ink); stroke-width: 2 }
.legend { font-size: .88rem; margin: .2rem 0 .6rem } .key .other { fill: var(--other) }
.legend span { margin-right: 1.2rem; white-space: nowrap }
details { margin: .6rem 0 } summary { cursor: pointer; color: var(--after) }
pre { background: var(--box); padding: .5rem .8rem; border-radius: 4px; white-space: pre-wrap;
  font-size: .88rem }
.wide { overflow-x: auto; margin: .8rem 0; background:
  linear-gradient(90deg, var(--paper) 30%, transparent) 0 0 / 3rem 100% no-repeat local,
  linear-gradient(270deg, var(--paper) 30%, transparent) 100% 0 / 3rem 100% no-repeat local,
  linear-gradient(90deg, var(--other), transparent) 0 0 / .8rem 100% no-repeat scroll,
  linear-gradient(270deg, var(--other), transparent) 100% 0 / .8rem 100% no-repeat scroll }
table { border-collapse: collapse; font-size: .88rem;
  font-variant-numeric: tabular-nums }
caption { text-align: left; color: var(--soft); padding-bottom: .3rem }
th, td { text-align: left; padding: .25rem .9rem .25rem 0; vertical-align: top }
th { border-bottom: 1px solid var(--soft) } td { border-bottom: 1px solid var(--rule) }
.n { text-align: right } .n, .s { white-space: nowrap }
.l { overflow-wrap: anywhere; min-width: 14ch }
table.bars { width: 100%; table-layout: fixed; margin: .8rem 0 } .bars th { font-weight: 400;
  border: 0; line-height: 1.25; padding-right: .6rem } .bars td { border: 0; line-height: 1.1 }
.bars thead th:first-child { width: max(18%, 5.8rem) }
.bars thead th { vertical-align: bottom; font-weight: 600 } .bars svg { height: 8px }
.bars rect, .bars line { vector-effect: non-scaling-stroke }
@media (max-width: 40rem) { .bars { font-size: .72rem } .bars thead th { font-size: .66rem }
  .bars thead th:first-child { width: 21% } .bars td, .bars th { padding-right: .3rem }
  nav a { white-space: normal } .n, .s { white-space: normal } td, th { padding-right: .6rem }
  td:last-child, th:last-child { padding-right: 0 } .l { min-width: 9ch } }
code { background: var(--box); padding: .1em .3em;
  border-radius: 3px; font-size: .9em; overflow-wrap: anywhere }
dt { font-weight: 600; margin-top: .5rem } dd { margin: 0 }
.button { display: inline-block; border: 1px solid var(--after); border-radius: 4px;
  padding: .3rem .8rem; text-decoration: none }
@media print { :root { --paper: #fff; --ink: #000; --soft: #444; --rule: #bbb; --box: #f4f4f2;
  --before: #c25100; --after: #0068a3; --other: #888; --good: #00704f; --warn: #8a4b00;
  --refit: #8a4fa0 }
  html { font-size: 10.5px } body { font-size: 1rem; max-width: none; padding: 0 }
  nav, .button { display: none }
  * { print-color-adjust: exact } .wide { overflow: visible } h2, h3 { break-after: avoid }
  .cause, tr { break-inside: avoid } summary { list-style: none }
  details::details-content { content-visibility: visible; height: auto; display: block } }
"""
