"""The index over all takes: what is packed in segments, and what a listing of takes says."""
