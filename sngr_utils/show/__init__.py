"""What the notebooks show: one module each with tables, figures and what is recorded."""
