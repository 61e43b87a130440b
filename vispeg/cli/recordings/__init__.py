"""Commands that make recordings and look at them: record, check, convert, motions."""
