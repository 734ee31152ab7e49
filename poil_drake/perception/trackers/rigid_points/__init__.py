"""What trackers of single points share: sight lines, a rigid fit to matched points, and state."""
