################################################################################
#
# libdc1394
#
################################################################################

LIBDC1394_VERSION = 2.2.6
LIBDC1394_SITE = https://downloads.sourceforge.net/project/libdc1394/libdc1394-2/$(LIBDC1394_VERSION)
LIBDC1394_LICENSE = LGPL-2.1+
LIBDC1394_LICENSE_FILES = COPYING
LIBDC1394_INSTALL_STAGING = YES
LIBDC1394_DEPENDENCIES = host-pkgconf libusb
# The examples would need SDL and X11; FireWire goes through the kernel, not through libraw1394.
LIBDC1394_CONF_OPTS = --disable-examples --without-x --disable-doxygen-doc
LIBDC1394_CONF_ENV = ac_cv_path_SDL_CONFIG=no

# ddxvideo needs the patches.
LIBDC1394_POST_RSYNC_HOOKS += DDXVIDEO_PATCH_OVERRIDDEN

$(eval $(autotools-package))
