"""The search: effects are proposed, fitted to some recordings, and accepted, exchanged or removed on held-out ones."""
