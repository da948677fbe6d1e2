################################################################################
#
# ddxvideo
#
################################################################################

DDXVIDEO_VERSION = $(DDX_VERSION)
DDXVIDEO_SITE = $(BR2_EXTERNAL_DDXVIDEO_PATH)/../package/ddxvideo
DDXVIDEO_SITE_METHOD = local
DDXVIDEO_LICENSE = GPL-2.0+ (programs), LGPL-2.1+ (libddxvideo)
DDXVIDEO_LICENSE_FILES = LICENSE LICENSES/LGPL-2.1.txt LICENSES/GPL-2.0.txt
DDXVIDEO_POST_RSYNC_HOOKS += DDXVIDEO_COPY_LICENSES
DDXVIDEO_INSTALL_STAGING = YES
DDXVIDEO_DEPENDENCIES = ddx ffmpeg libdc1394 libdrm libsrtp libusb x264
DDXVIDEO_CONF_OPTS = -Ddrm=enabled -Diidc=enabled -Dsrtp=enabled
DDXVIDEO_USERS = $(call ddx-users,ddxvideo)
DDXVIDEO_POST_INSTALL_TARGET_HOOKS += DDXVIDEO_INSTALL_INIT_SCRIPTS

$(eval $(meson-package))
