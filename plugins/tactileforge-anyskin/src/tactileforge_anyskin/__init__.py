"""AnySkin and ReSkin for tactileforge."""
