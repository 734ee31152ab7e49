"""LCM networks and mailboxes."""
