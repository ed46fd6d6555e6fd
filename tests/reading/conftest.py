from dataset_fixtures import conforms, make_image, make_images, make_video, write  # noqa: F401
