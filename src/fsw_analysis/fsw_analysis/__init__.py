"""Analysis of recorded welds: aligned signals, events, figures of merit, figures, comparison and verification."""
