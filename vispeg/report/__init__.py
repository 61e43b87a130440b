"""Reports: one self-contained HTML file per diagnosis or comparison, figures, and the short tables of the terminal."""
