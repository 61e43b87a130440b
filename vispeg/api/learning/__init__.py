"""Policies made from other policies: fine-tuned, combined, exported."""
