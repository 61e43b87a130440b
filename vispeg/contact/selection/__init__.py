"""The search over effects of contact: profiles, fits, what stays, and its intervals."""
