"""What all pages that people click share: access, security headers, static files, and meshes for the browser."""
