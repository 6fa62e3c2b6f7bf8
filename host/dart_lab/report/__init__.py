"""Building blocks of all pages: HTML, tables, SVG charts, numbers with errors."""
