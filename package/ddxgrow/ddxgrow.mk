################################################################################
#
# ddxgrow
#
################################################################################

DDXGROW_VERSION = $(DDX_VERSION)
DDXGROW_SITE = $(BR2_EXTERNAL_DDXVIDEO_PATH)/../package/ddxgrow
DDXGROW_SITE_METHOD = local
DDXGROW_LICENSE = GPL-2.0+
DDXGROW_LICENSE_FILES = LICENSES/GPL-2.0.txt
DDXGROW_POST_RSYNC_HOOKS += DDXVIDEO_COPY_LICENSES
DDXGROW_DEPENDENCIES = util-linux

$(eval $(meson-package))
