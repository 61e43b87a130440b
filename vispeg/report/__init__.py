"""Reports: one self-contained HTML file per result, figures, and short tables for the terminal."""
