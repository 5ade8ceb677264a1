"""Gymnasium environments on the compiled vehicle; `skywright.envs` has the public names."""
