"""Joint-space and pose-space motion planning. No pydrake."""
