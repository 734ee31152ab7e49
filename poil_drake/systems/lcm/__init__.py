"""LCM networks, and mailboxes for their messages."""
