"""Drake LeafSystems: ports, state and events around the pure floors."""
