// Layers of a perceptron in plain JavaScript.

/** A linear layer. weights: row by row. bias: of each row. */
export class Layer {
  constructor(weights, bias) {
    Object.assign(this, { weights, bias });
  }

  of(inputs) {
    const { weights, bias } = this, count = inputs.length;
    return Float64Array.from(bias, (sum, row) => {
      for (let i = 0, k = row * count; i < count; i++, k++) sum += weights[k] * inputs[i];
      return sum;
    });
  }
}

export function positive(values) {
  return values.map((value) => Math.max(0, value));
}
