"""The build guide as one PDF: pages 1 to 10, builder's log, bill of materials, full-size sheets.

    python docs/guide_pdf.py OUT.pdf

Sphinx makes one HTML page of them, WeasyPrint prints it: A4, drill sheets and routing at exactly
full size.
"""

from __future__ import annotations

import re
import shutil
import sys
import tempfile
from pathlib import Path

from sphinx.application import Sphinx
from weasyprint import HTML

ROOT = Path(__file__).resolve().parents[1]
CONF = """
extensions = ["myst_parser"]
myst_enable_extensions = ["colon_fence", "attrs_inline"]
myst_heading_anchors = 3
html_theme = "basic"
html_show_sourcelink = html_show_copyright = html_show_sphinx = False
html_permalinks = False
suppress_warnings = ["myst.xref_missing", "image.not_readable"]
"""
STYLE = """
@page { size: A4; margin: 17mm 16mm 18mm;
        @bottom-center { content: counter(page); font: 9pt sans-serif; color: #555 } }
@page tall { margin: 8mm 16mm; @bottom-center { content: none } } .tall { page: tall }
@page sheet { margin: 0; @bottom-center { content: none } }
body { font: 10pt/1.42 "Liberation Sans", "DejaVu Sans", sans-serif; color: #20242a }
h1 { font-size: 22pt } h2 { font-size: 17pt } h3 { font-size: 12.5pt; margin-top: 1.3em }
h1, h2, h3, h4 { break-after: avoid; color: #14304f } h2 { break-before: page }
.toctree-wrapper > section:first-child h2, div > section:first-of-type > h2 { break-before: auto }
img { max-width: 100%; max-height: 112mm; object-fit: contain; break-inside: avoid }
table { border-collapse: collapse; width: 100%; font-size: 8.6pt; margin: .6em 0 }
td, th { border-bottom: .3pt solid #b5bac0; padding: 1.2mm 1.6mm; vertical-align: top }
td, th { text-align: left; overflow-wrap: normal } th { background: #eef2f6; white-space: nowrap }
img[src*="power_tree"], img[src*="nano_pins"], img[src$="/cutoff_mux.svg"], img[src*="mux_board"],
img[src*="mux_schematic"] { width: 150mm !important; max-height: 236mm; display: block }
img[src*="routing_"] { height: auto !important; max-height: none; max-width: none }
img[src*="routing_minimal"] { width: 160mm !important }
img[src*="routing_cutoff"] { width: 112mm !important }
h2 + ul, h3 + ul, h4 + ul { break-inside: avoid; break-after: avoid }
tr { break-inside: avoid } p, li { orphans: 2; widows: 2; overflow-wrap: break-word }
td p, th p { margin: 0 } li > p { margin: .15em 0 } ul, ol { margin: .4em 0 }
td code { overflow-wrap: break-word } td:first-child code { white-space: nowrap }
pre { background: #f3f5f7; padding: 2mm 3mm; font-size: 8.4pt; white-space: pre-wrap }
code { font-size: 92% } a { color: inherit; text-decoration: none }
nav, .related, .sphinxsidebar, .footer { display: none }
.sheet { page: sheet; break-before: page }
.sheet img { width: 210mm; height: 297mm; max-height: none; max-width: none }
"""
SHEETS = ("base_plate", "upper_plate", "back_plate", "striped_ring")


def sources(folder: Path) -> Path:
    """Pages of the guide with an index of their own; the folder that Sphinx reads."""
    docs = folder / "docs"
    shutil.copytree(ROOT / "docs" / "build_guide", docs / "build_guide")
    (docs / "reference").mkdir()
    shutil.copy(ROOT / "docs" / "reference" / "bom.md", docs / "reference")
    (folder / "hardware").symlink_to(ROOT / "hardware")
    pages = [f"build_guide/{p.stem}" for p in sorted((docs / "build_guide").glob("[0-9]*.md"))]
    pages += ["build_guide/log", "reference/bom"]
    (docs / "index.md").write_text("# Build guide of DART\n\n```{toctree}\n:maxdepth: 1\n"
                                   + "\n".join(pages) + "\n```\n", encoding="utf-8")
    (docs / "conf.py").write_text(CONF, encoding="utf-8")
    return docs


def page(folder: Path) -> Path:
    """All pages as one HTML file. Raises RuntimeError where Sphinx fails."""
    docs, out = sources(folder), folder / "html"
    app = Sphinx(str(docs), str(docs), str(out), str(folder / "trees"), "singlehtml", status=None,
                 warning=None)
    app.build()
    if app.statuscode:
        raise RuntimeError("Sphinx could not read the guide: make docs says why")
    file = out / "index.html"
    text = file.read_text(encoding="utf-8")
    text = re.sub(r"<link[^>]*stylesheet[^>]*>|<script.*?</script>", "", text, flags=re.DOTALL)
    text = re.sub(r"<a[^>]*>\s*(<img[^>]*routing_minimal[^>]*>)\s*</a>",
                  r'<div class="tall">\1</div>', text)
    drill = ROOT / "hardware" / "drill"
    sheets = "".join(f'<div class="sheet"><img src="{(drill / f"{n}.svg").as_uri()}"></div>'
                     for n in SHEETS)
    file.write_text(text.replace("</head>", f"<style>{STYLE}</style></head>")
                    .replace("</body>", f"{sheets}</body>"), encoding="utf-8")
    return file


def main() -> int:
    """Write the PDF named by the argument."""
    args = sys.argv[1:]
    if len(args) != 1 or args[0] in ("-h", "--help"):
        sys.stdout.write(__doc__ or "")
        return 0 if args in (["-h"], ["--help"]) else 2
    out = Path(args[0])
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        HTML(str(page(Path(folder)))).write_pdf(out, optimize_images=True, dpi=220,
                                                presentational_hints=True)
    sys.stdout.write(f"{out}: {out.stat().st_size / 1e6:.1f} MB\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
