################################################################################
#
# ddxservice
#
################################################################################

DDXSERVICE_VERSION = $(DDX_VERSION)
DDXSERVICE_SITE = $(BR2_EXTERNAL_DDXVIDEO_PATH)/../package/ddxservice
DDXSERVICE_SITE_METHOD = local
DDXSERVICE_LICENSE = GPL-2.0+
DDXSERVICE_LICENSE_FILES = LICENSE
DDXSERVICE_USERS = $(call ddx-users,ddxservice)

$(eval $(meson-package))
