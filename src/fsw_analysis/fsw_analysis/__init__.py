"""Analysis of recorded welds: aligned signals, figures of merit, figures, comparison and verification."""
