"""What the whole arm does again under the controller that ran: blows, and whole episodes as the last judge."""
