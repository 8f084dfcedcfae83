"""Relighting: a model under any lights, from any viewpoint near the captured one."""
