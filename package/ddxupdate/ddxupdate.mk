################################################################################
#
# ddxupdate
#
################################################################################

DDXUPDATE_VERSION = $(DDX_VERSION)
DDXUPDATE_SITE = $(BR2_EXTERNAL_DDXVIDEO_PATH)/../package/ddxupdate
DDXUPDATE_SITE_METHOD = local
DDXUPDATE_LICENSE = GPL-2.0+
DDXUPDATE_LICENSE_FILES = LICENSES/GPL-2.0.txt
DDXUPDATE_POST_RSYNC_HOOKS += DDXVIDEO_COPY_LICENSES
DDXUPDATE_DEPENDENCIES = ddx libsodium

$(eval $(meson-package))
