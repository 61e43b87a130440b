"""Make policies from other policies: fine-tune and combine."""
