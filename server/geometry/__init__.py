"""Poses, cameras, boxes and axis conventions shared by every stage."""
