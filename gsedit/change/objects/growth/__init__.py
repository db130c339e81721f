"""Growth: new Gaussians that lie or grow on surfaces, as snow, moss, dust, ice, leaves."""
