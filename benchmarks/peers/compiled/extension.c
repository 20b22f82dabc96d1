/* The filter of filter.c as an extension of Python: the cheapest way there is from Python into C and back. */
#define NPY_NO_DEPRECATED_API NPY_2_0_API_VERSION
#include <Python.h>
#include <numpy/arrayobject.h>

#include "filter.h"

void one_epoch(Filter *f, const double spots[6], const double push[3], double answer[ANSWER]);

/* The doubles of an argument, if it is an array of that many, row by row; else NULL and an exception. */
static double *doubles(PyObject *argument, npy_intp count) {
    if (PyArray_Check(argument)) {
        PyArrayObject *array = (PyArrayObject *)argument;
        if (PyArray_TYPE(array) == NPY_DOUBLE && PyArray_ISCARRAY_RO(array) && PyArray_SIZE(array) == count)
            return PyArray_DATA(array);
    }
    PyErr_Format(PyExc_TypeError, "not an array of %zd doubles, row by row", (Py_ssize_t)count);
    return NULL;
}

static PyObject *step(PyObject *Py_UNUSED(module), PyObject *const *arguments, Py_ssize_t count) {
    double answer[ANSWER], *memory, *spots, *push;
    npy_intp sides[2] = {6, 6};
    if (count != 3) return PyErr_Format(PyExc_TypeError, "step(memory, spots, acceleration)");
    if (!(memory = doubles(arguments[0], sizeof(Filter) / sizeof(double)))) return NULL;
    if (!(spots = doubles(arguments[1], 6)) || !(push = doubles(arguments[2], 3))) return NULL;
    one_epoch((Filter *)memory, spots, push, answer);
    PyObject *state = PyArray_SimpleNew(1, sides, NPY_DOUBLE), *covariance = PyArray_SimpleNew(2, sides, NPY_DOUBLE);
    if (state == NULL || covariance == NULL) {
        Py_XDECREF(state), Py_XDECREF(covariance);
        return NULL;
    }
    memcpy(PyArray_DATA((PyArrayObject *)state), answer + 1, 6 * sizeof(double));
    memcpy(PyArray_DATA((PyArrayObject *)covariance), answer + 7, 36 * sizeof(double));
    return Py_BuildValue("dNN", answer[0], state, covariance);
}

static PyMethodDef methods[] = {
    {"step", (PyCFunction)(void (*)(void))step, METH_FASTCALL, NULL},
    {NULL, NULL, 0, NULL},
};
static PyModuleDef definition = {PyModuleDef_HEAD_INIT, "plain_c", NULL, -1, methods, NULL, NULL, NULL, NULL};

PyMODINIT_FUNC PyInit_plain_c(void) {
    import_array();
    return PyModule_Create(&definition);
}
