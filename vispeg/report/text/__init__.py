"""Results as text: numbers, sentences and tables, for terminals of any width."""
