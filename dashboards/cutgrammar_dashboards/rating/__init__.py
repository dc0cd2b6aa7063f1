"""The page on which people rate results against goals, without knowing which method reached them."""
