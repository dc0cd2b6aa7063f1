"""Who runs what where: in this process, or as Ray actors."""
