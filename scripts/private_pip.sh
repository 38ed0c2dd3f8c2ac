# Sourced before pip or uv is called: of their settings, only what says where packages come from,
# and how, may count here.
if [ "${BASH_SOURCE[0]}" = "$0" ]; then sed -n '1,2s/^# //p' "$0" >&2; exit 2; fi
for setting in $(compgen -e | grep -E '^(PIP|UV)_' || true); do
  case "$setting" in
    *_INDEX* | *_CERT* | *_PROXY | *_FIND_LINKS | *_HOST | *_TIMEOUT | *_RETRIES | *_CACHE_DIR) ;;
    *_CONFIG_FILE | *_NATIVE_TLS | *_OFFLINE | *_CONCURRENT_* | *_KEYRING_PROVIDER | *_LINK_MODE) ;;
    *) unset "$setting" ;;
  esac
done
export PIP_DISABLE_PIP_VERSION_CHECK=1
