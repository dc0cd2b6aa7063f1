"""Fragments as closed meshes or point clouds: poses, planes, slicing, canonical frames, comparison and files."""
