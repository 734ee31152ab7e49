"""The stability theory of the field: saddles, sampling, delay and degenerate point sets."""
