"""Benchmark `stereo`: 16-megapixel pairs to range maps."""
