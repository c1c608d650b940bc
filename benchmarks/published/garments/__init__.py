"""Benchmark `garments`: four garments, the closed loop beside simpler policies."""
