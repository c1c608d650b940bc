"""The decisions: which wrinkle next, with how many arms, plan and verdict, or the reason to stop. No Drake systems."""
