"""What is known: cameras, depth images, maps, and the objects and regions seen in them."""
