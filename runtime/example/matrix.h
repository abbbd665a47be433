// Transforms of a scene, which an engine has in its own library: 4 x 4, row by row.
#pragma once

#include <cmath>
#include <istream>

constexpr double PI = 3.14159265358979323846;

struct Matrix {
    double at[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};

    // Takes a point along.
    void take(const double *point, double *moved) const {
        for (int i = 0; i < 3; i++) {
            const double *row = at + 4 * i;
            moved[i] = row[0] * point[0] + row[1] * point[1] + row[2] * point[2] + row[3];
        }
    }
};

inline Matrix operator*(const Matrix &left, const Matrix &right) {
    Matrix product;
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++) {
            product.at[4 * i + j] = 0;
            for (int k = 0; k < 4; k++) product.at[4 * i + j] += left.at[4 * i + k] * right.at[4 * k + j];
        }
    return product;
}

inline Matrix shift(double x, double y, double z) {
    Matrix matrix;
    matrix.at[3] = x;
    matrix.at[7] = y;
    matrix.at[11] = z;
    return matrix;
}

// A turn about the x, y or z axis.
inline Matrix turn(int axis, double degrees) {
    Matrix matrix;
    int one = (axis + 1) % 3, two = (axis + 2) % 3;
    double cosine = std::cos(degrees * PI / 180), sine = std::sin(degrees * PI / 180);
    matrix.at[5 * one] = matrix.at[5 * two] = cosine;
    matrix.at[4 * one + two] = -sine;
    matrix.at[4 * two + one] = sine;
    return matrix;
}

// Inverse of a turn, a scale and a shift.
inline Matrix inverse(const Matrix &matrix) {
    Matrix back;
    double size = 0;
    for (int i = 0; i < 3; i++) size += matrix.at[4 * i] * matrix.at[4 * i];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) back.at[4 * i + j] = matrix.at[4 * j + i] / size;
    for (int i = 0; i < 3; i++) {
        back.at[4 * i + 3] = 0;
        for (int j = 0; j < 3; j++) back.at[4 * i + 3] -= back.at[4 * i + j] * matrix.at[4 * j + 3];
    }
    return back;
}

inline std::istream &operator>>(std::istream &file, Matrix &matrix) {
    for (double &number : matrix.at) file >> number;
    return file;
}
