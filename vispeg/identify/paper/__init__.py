"""The paper's way of identification: its protocol of fitting, and what that determines."""
