"""What is said of a search: verdict, rivals, intervals, the next motion to record."""
