#include "meshopt.h"

#include <dlfcn.h>
#include <pthread.h>

#include "base/library.h"
#include "base/log.h"

#define LIBRARY "libmeshoptimizer.so.2d"
#define MAX_STRIDE 256
#define MAX_SHRINK 64 /* a byte of 16 elements that are alike takes two bits */

typedef int decode_fn(void *out, size_t count, size_t width, const unsigned char *encoded, size_t size);
typedef void filter_fn(void *elements, size_t count, size_t stride);

static decode_fn *decoders[3]; /* by qm_gltf_coding */
static filter_fn *decode_exponential;
static bool is_loaded;

static void load(void)
{
    void *library = dlopen(LIBRARY, RTLD_NOW | RTLD_LOCAL);
    is_loaded = library &&
                qm_library_find(library, "meshopt_decodeVertexBuffer", &decoders[QM_GLTF_ATTRIBUTES]) &&
                qm_library_find(library, "meshopt_decodeIndexBuffer", &decoders[QM_GLTF_TRIANGLES]) &&
                qm_library_find(library, "meshopt_decodeIndexSequence", &decoders[QM_GLTF_INDICES]) &&
                qm_library_find(library, "meshopt_decodeFilterExp", &decode_exponential);
    if (!is_loaded)
        qm_log(QM_LOG_WARN, "%s cannot be loaded: %s", LIBRARY,
               library ? "a function is missing" : dlerror());
}

bool qm_meshopt_is_possible(const qm_gltf_view *view)
{
    if (view->coding == QM_GLTF_ATTRIBUTES)
        return view->stride > 0 && view->stride <= MAX_STRIDE && view->stride % 4 == 0 &&
               view->count / MAX_SHRINK <= view->size / view->stride + 1;
    bool is_whole = view->coding == QM_GLTF_INDICES || view->count % 3 == 0;
    return is_whole && (view->stride == 2 || view->stride == 4) && view->count / 3 <= view->size;
}

qm_meshopt_outcome qm_meshopt_decode(const qm_gltf_view *view, const uint8_t *encoded, uint8_t *out)
{
    static pthread_once_t once = PTHREAD_ONCE_INIT;
    QM_ASSERT(view && encoded && out && qm_meshopt_is_possible(view));
    pthread_once(&once, load);
    if (!is_loaded) return QM_MESHOPT_UNAVAILABLE;
    size_t count = (size_t)view->count, stride = (size_t)view->stride;
    if (decoders[view->coding](out, count, stride, encoded, (size_t)view->size) != 0)
        return QM_MESHOPT_MALFORMED;
    if (view->filter == QM_GLTF_EXPONENTIAL) decode_exponential(out, count, stride);
    return QM_MESHOPT_DONE;
}
