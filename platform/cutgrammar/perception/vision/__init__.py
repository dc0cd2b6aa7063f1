"""From a fused point cloud to fragments: segmentation, completion and what is known from earlier views (IV-D)."""
