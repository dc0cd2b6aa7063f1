"""From a fused point cloud to fragments: segmentation, completion and tracking over several views (IV-D)."""
