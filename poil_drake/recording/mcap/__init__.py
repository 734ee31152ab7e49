"""Reading and writing of MCAP files, and the messages in them."""
