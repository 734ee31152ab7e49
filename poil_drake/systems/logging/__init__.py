"""Systems that write the closed loop to a run log and keep pictures of it."""
