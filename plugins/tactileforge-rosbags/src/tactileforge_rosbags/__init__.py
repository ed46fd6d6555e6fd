"""ROS bags for tactileforge: topics of pictures, wrenches and joints as recordings."""
