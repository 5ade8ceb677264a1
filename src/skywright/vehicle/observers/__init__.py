"""Observers of the truth: what the plant's side and recordings need of MuJoCo's state."""
