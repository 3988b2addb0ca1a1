/* abi.c - which version of the interface this library speaks. */
#include "blob.h"

int32_t blob_abi(void)
{
    return BLOB_ABI;
}

const char *blob_isa(void)
{
    return "baseline";
}
