"""The colors by which segments are told apart, by everybody."""

SEGMENT_COLORS: tuple[tuple[int, int, int], ...] = (
    (150, 150, 150),
    *((230, 159, 0), (109, 228, 250), (20, 58, 97)),
    *((249, 58, 20), (230, 115, 111), (20, 114, 100), (177, 250, 250)),
    *((160, 90, 190), (222, 200, 245), (128, 45, 20), (250, 183, 121)),
)
"""RGB of the labels 0 (no segment) to 11. Found from the colors of Okabe and Ito (2008) by a search
for those whose neighbors on the body, and right and left, look most different to people with and
without a deficiency of color vision: 30 in CIELAB at least."""
